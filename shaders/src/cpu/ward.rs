//! Reflection from a rough surface. GPU twin: `ward.wgsl`.
