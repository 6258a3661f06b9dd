//! What the bake is working on, for the message of a program that runs out of memory.
//!
//! The name is kept in fixed memory: there is none left when it is needed.

use std::io::Write;
use std::sync::Mutex;

/// Longer names are cut.
const MAX_BYTES: usize = 160;

struct Subject {
    text: [u8; MAX_BYTES],
    length: usize,
}

static SUBJECT: Mutex<Subject> = Mutex::new(Subject { text: [0; MAX_BYTES], length: 0 });

/// Remembers the input or object that is read, or the block that is baked, last.
pub fn set(name: std::fmt::Arguments<'_>) {
    if let Ok(mut subject) = SUBJECT.lock() {
        let mut rest = &mut subject.text[..];
        // A name that does not fit is cut.
        let _ = rest.write_fmt(name);
        subject.length = MAX_BYTES - rest.len();
    }
}

/// Writes the name and a colon, or nothing if there is none. Never waits and never allocates. Control characters are
/// replaced.
pub fn write(out: &mut impl Write) {
    let Ok(subject) = SUBJECT.try_lock() else { return };
    if subject.length == 0 {
        return;
    }
    for byte in &subject.text[..subject.length] {
        let _ = out.write_all(&[if byte.is_ascii_control() { b'?' } else { *byte }]);
    }
    let _ = out.write_all(b": ");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_are_cut_and_control_characters_replaced() {
        set(format_args!("a.obj: object {}\x1b[2J{}", 7, "x".repeat(1000)));
        let mut out = Vec::new();
        write(&mut out);
        let text = String::from_utf8(out).unwrap();
        assert!(text.starts_with("a.obj: object 7?[2Jxxx") && text.ends_with("x: "), "{text}");
        assert_eq!(text.len(), MAX_BYTES + 2);
    }
}
