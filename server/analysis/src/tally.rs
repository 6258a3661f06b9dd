//! What is counted of moments with and without light.

/// What is counted of moments, in sequence.
pub(crate) trait Tally: Copy + Default + Send + Sync {
    /// What is counted of at most [`MAX_PART`] moments: as small as can be, because each thread has one for each cell.
    type Part: Copy + Default + Send + Sync;
    /// Whether it matters which moment follows which.
    const HAS_SEQUENCE: bool;
    /// Adds a moment after `before` others. `light` is 0 in the dark.
    fn add(part: &mut Self::Part, light: f32, before: u16);
    /// This and what came after it. `moments` are those of both.
    #[must_use]
    fn then(self, next: Self::Part, moments: [u16; 2]) -> Self;
    /// What has been counted.
    fn value(self) -> f32;
}

/// Most moments of a part.
pub(crate) const MAX_PART: usize = 255;

/// Moments with light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Count(u16);

impl Tally for Count {
    type Part = u8;
    const HAS_SEQUENCE: bool = false;

    fn add(part: &mut u8, light: f32, _: u16) {
        *part += u8::from(light > 0.0);
    }

    fn then(self, next: u8, _: [u16; 2]) -> Self {
        Self(self.0 + u16::from(next))
    }

    fn value(self) -> f32 {
        f32::from(self.0)
    }
}

/// All light.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sum(f32);

impl Tally for Sum {
    type Part = f32;
    const HAS_SEQUENCE: bool = false;

    fn add(part: &mut f32, light: f32, _: u16) {
        *part += light;
    }

    fn then(self, next: f32, _: [u16; 2]) -> Self {
        Self(self.0 + next)
    }

    fn value(self) -> f32 {
        self.0
    }
}

/// Moments with light without one in the dark between: at the beginning, at the end, and most of all.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct LitRun {
    first: u16,
    last: u16,
    longest: u16,
}

impl Tally for LitRun {
    type Part = Self;
    const HAS_SEQUENCE: bool = true;

    fn add(part: &mut Self, light: f32, before: u16) {
        if light <= 0.0 {
            part.last = 0;
            return;
        }
        part.last += 1;
        part.longest = part.longest.max(part.last);
        if part.last == before + 1 {
            part.first = part.last;
        }
    }

    fn then(self, next: Self, moments: [u16; 2]) -> Self {
        Self {
            first: if self.first == moments[0] { self.first + next.first } else { self.first },
            last: if next.last == moments[1] { self.last + next.last } else { next.last },
            longest: self.longest.max(next.longest).max(self.last + next.first),
        }
    }

    fn value(self) -> f32 {
        f32::from(self.longest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(text: &[u8]) -> LitRun {
        let mut run = LitRun::default();
        (0u16..).zip(text).for_each(|(before, c)| LitRun::add(&mut run, f32::from(*c - b'0'), before));
        run
    }

    #[test]
    fn runs_are_the_same_however_a_day_is_divided() {
        for text in ["0011101", "1111", "0000", "10111011", "01", ""] {
            let whole = run(text.as_bytes());
            let longest = text.split('0').map(str::len).max().unwrap();
            assert_eq!(whole.value(), longest as f32, "{text}");
            for at in 0..=text.len() {
                let (a, b) = text.as_bytes().split_at(at);
                assert_eq!(run(a).then(run(b), [a.len() as u16, b.len() as u16]), whole, "{text} at {at}");
            }
        }
    }
}
