//! Entry `drivers`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("drivers", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/drivers")),
    |input: &[u8]| lrfslam_tests::entries::drivers(input)
);
