//! Entry `logs`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("logs", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/logs")),
    |input: &[u8]| lrfslam_tests::entries::logs(input)
);
