//! What the scenario tests share.
#![forbid(unsafe_code)]
