//! Which object a part of a column shows: the one with the largest area.

use insula_protocol::blockmap::NO_OBJECT;

/// Areas by object. Few objects share a part of a column.
#[derive(Debug, Clone, Default)]
pub(crate) struct ObjectVotes(Vec<(u32, f32)>);

impl ObjectVotes {
    /// Adds an area of an object. [`NO_OBJECT`] counts like any other.
    pub(crate) fn add(&mut self, object: u32, area: f32) {
        match self.0.iter_mut().find(|(known, _)| *known == object) {
            Some((_, sum)) => *sum += area,
            None => self.0.push((object, area)),
        }
    }

    /// The object with the largest area, of equal ones the first that was added; [`NO_OBJECT`] without any.
    pub(crate) fn winner(&self) -> u32 {
        let larger = |best: (u32, f32), vote: &(u32, f32)| if vote.1 > best.1 { *vote } else { best };
        self.0.iter().fold((NO_OBJECT, 0.0), larger).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_area_wins_and_the_first_of_equals() {
        let mut votes = ObjectVotes::default();
        assert_eq!(votes.winner(), NO_OBJECT);
        for (object, area) in [(5, 1.0), (3, 2.0), (5, 1.0), (9, 1.5)] {
            votes.add(object, area);
        }
        assert_eq!(votes.winner(), 5);
        votes.add(9, 1.0);
        assert_eq!(votes.winner(), 9);
    }
}
