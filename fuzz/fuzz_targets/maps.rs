//! Entry `maps`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("maps", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/maps")),
    |input: &[u8]| lrfslam_tests::entries::maps(input)
);
