//! Load on a server: in an open loop, and beyond its capacity.

pub mod open_loop;
pub mod overload;
