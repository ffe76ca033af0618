//! What a run has to tell: its report, how far it can be trusted, its steps.

pub mod quality;
pub mod report;
pub mod step_table;
