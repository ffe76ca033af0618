//! The simulated robot, its laser range finder and its world; filled by later work.
#![forbid(unsafe_code)]
