//! The report of one or more runs: one self-contained HTML file.
