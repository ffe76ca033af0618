//! Entry `journals`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("journals", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/journals")),
    |input: &[u8]| lrfslam_tests::entries::journals(input)
);
