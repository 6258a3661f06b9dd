//! Load on a server: in an open loop, beyond its capacity, and for a long time.

pub mod open_loop;
pub mod overload;
pub mod soak;
