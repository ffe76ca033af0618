//! The program as its user sees it: what goes in, what comes out, and what is said about wrong input. One binary for all, linked once.

mod accuracy;
mod bad_days;
mod bad_input;
mod bad_table;
mod cloud;
mod common;
mod doctor;
mod drawn_maps;
#[cfg(feature = "experiments")]
mod experiment;
mod keeps;
mod left_out;
mod localize;
mod map_server;
#[cfg(feature = "experiments")]
mod prove;
mod python;
mod real_logs;
mod results;
mod spinning;
mod vocabulary;
