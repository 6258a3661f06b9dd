//! Materials of the ground, one for each sample.

/// Defines an enum, and lists its variants.
macro_rules! listed {
    ($(#[$meta:meta])* pub enum $name:ident { $($(#[$doc:meta])* $variant:ident,)* }) => {
        $(#[$meta])*
        pub enum $name {
            $($(#[$doc])* $variant,)*
        }

        impl $name {
            /// All variants, in their order.
            pub const ALL: [Self; [$($name::$variant),*].len()] = [$(Self::$variant),*];
        }
    };
}
pub(super) use listed;

listed! {
    /// The material at a sample of the picture.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
    #[repr(u8)]
    pub enum PaintMaterial {
        // Ground between buildings, by what land is used for.
        ResidentialGround,
        CommercialGround,
        IndustrialGround,
        RailwayGround,
        // Cover.
        Farmland,
        Meadow,
        Park,
        Grass,
        Graveyard,
        Scrub,
        Forest,
        Wetland,
        Sand,
        Rock,
        Earth,
        Water,
        // What people walk on.
        Pavement,
        Paving,
        Setts,
        Concrete,
        Gravel,
        Wood,
        Clay,
        Turf,
        Tread,
        Kerb,
        // Roads.
        Carriageway,
        Asphalt,
        SideAsphalt,
        Cycleway,
        Marking,
        // Rails.
        Ballast,
        Sleeper,
        Rail,
        StreetRail,
    }
}

impl PaintMaterial {
    /// Its place in [`Self::ALL`].
    pub fn index(self) -> usize {
        usize::from(self as u8)
    }
}

/// A set of materials, and whether it contains samples without one.
#[derive(Debug, Clone, Copy)]
pub(super) struct MaterialSet {
    contains: [bool; 256],
    contains_nothing: bool,
}

impl MaterialSet {
    pub(super) fn new(materials: &[PaintMaterial], contains_nothing: bool) -> Self {
        let mut contains = [false; 256];
        for material in materials {
            contains[material.index()] = true;
        }
        Self { contains, contains_nothing }
    }

    /// Whether the set contains a sample of the canvas.
    pub(super) fn contains(&self, [material, _, _, alpha]: [u8; 4]) -> bool {
        if alpha == 0 { self.contains_nothing } else { self.contains[usize::from(material)] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_contains_its_materials_only() {
        let set = MaterialSet::new(&[PaintMaterial::Rail], false);
        assert!(
            set.contains([PaintMaterial::Rail as u8, 0, 0, 255]) && !set.contains([PaintMaterial::Rail as u8, 0, 0, 0])
        );
        assert!(!set.contains([PaintMaterial::Water as u8, 0, 0, 255]));
    }
}
