//! Entry `worlds`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("worlds", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/worlds")),
    |input: &[u8]| lrfslam_tests::entries::worlds(input)
);
