"""A second decoder of Insula's tiles, written after docs/formats.md. It shares no code with the Rust one."""
