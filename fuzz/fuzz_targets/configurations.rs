//! Entry `configurations`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("configurations", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/configurations")),
    |input: &[u8]| lrfslam_tests::entries::configurations(input)
);
