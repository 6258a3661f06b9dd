//! What is counted of lit and dark moments.

/// What is counted of the moments of a day, in sequence.
pub(crate) trait Tally: Copy + Default + Send + Sync {
    /// Adds a moment after `before` others.
    fn add(&mut self, is_lit: bool, before: u16);
    /// This and what came after it. `steps` are the moments of both.
    #[must_use]
    fn then(self, next: Self, steps: [u16; 2]) -> Self;
    /// Moments that count.
    fn steps(self) -> u32;
}

/// Lit moments.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Count(u16);

impl Tally for Count {
    fn add(&mut self, is_lit: bool, _: u16) {
        self.0 += u16::from(is_lit);
    }

    fn then(self, next: Self, _: [u16; 2]) -> Self {
        Self(self.0 + next.0)
    }

    fn steps(self) -> u32 {
        u32::from(self.0)
    }
}

/// Lit moments without a dark one between: at the beginning, at the end, and most of all.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct LitRun {
    first: u16,
    last: u16,
    longest: u16,
}

impl Tally for LitRun {
    fn add(&mut self, is_lit: bool, before: u16) {
        if !is_lit {
            self.last = 0;
            return;
        }
        self.last += 1;
        self.longest = self.longest.max(self.last);
        if self.last == before + 1 {
            self.first = self.last;
        }
    }

    fn then(self, next: Self, steps: [u16; 2]) -> Self {
        Self {
            first: if self.first == steps[0] { self.first + next.first } else { self.first },
            last: if next.last == steps[1] { self.last + next.last } else { next.last },
            longest: self.longest.max(next.longest).max(self.last + next.first),
        }
    }

    fn steps(self) -> u32 {
        u32::from(self.longest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(text: &[u8]) -> LitRun {
        let mut run = LitRun::default();
        (0u16..).zip(text).for_each(|(before, c)| run.add(*c == b'1', before));
        run
    }

    #[test]
    fn runs_are_the_same_however_a_day_is_divided() {
        for text in ["0011101", "1111", "0000", "10111011", "01", ""] {
            let whole = run(text.as_bytes());
            let longest = text.split('0').map(str::len).max().unwrap();
            assert_eq!(whole.steps(), longest as u32, "{text}");
            for at in 0..=text.len() {
                let (a, b) = text.as_bytes().split_at(at);
                assert_eq!(run(a).then(run(b), [a.len() as u16, b.len() as u16]), whole, "{text} at {at}");
            }
        }
    }
}
