//! Entry `bags`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| lrfslam_tests::entries::bags(input));
