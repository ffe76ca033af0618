//! Entry `bags`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("bags", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/bags")),
    |input: &[u8]| lrfslam_tests::entries::bags(input)
);
