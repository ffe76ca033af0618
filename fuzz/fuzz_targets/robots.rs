//! Entry `robots`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("robots", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/robots")),
    |input: &[u8]| lrfslam_tests::entries::robots(input)
);
