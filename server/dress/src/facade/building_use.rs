//! Which windows a building has, by its use.

use insula_source::text::split_words;

/// Kind of facade.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum FacadeUse {
    /// Dwellings, and everything whose use is not known.
    #[default]
    Home,
    /// Offices, shops, schools and public buildings: higher storeys and wider windows.
    Office,
    /// Halls, garages and churches: storeys and bays of dwellings would be wrong.
    Windowless,
}

/// Words in the names of uses, in the languages of the sources that are common. The first row that has one decides.
const USES: &[(FacadeUse, &[&str])] = &[
    (
        FacadeUse::Windowless,
        &split_words::<25>(
            "industr factory storage warehouse depot hangar parking garage carport shed roof barn stable farm_aux \
            greenhouse church chapel cathedral mosque temple religious kirche kerk 工場 倉庫",
        ),
    ),
    (
        FacadeUse::Office,
        &split_words::<20>(
            "office commerc retail business hotel hospital public civic school university transport kantoor winkel \
            büro gewerbe 業務 商業 宿泊 31001_2 31001_3",
        ),
    ),
];

impl FacadeUse {
    /// By the use of the building, such as `apartments` in OpenStreetMap or 411 in PLATEAU; `None` if it is not known.
    pub fn of_use(name: &str) -> Option<Self> {
        let name = name.trim().to_lowercase();
        // PLATEAU's codes: 43x are transport and storage, 44x factories, 45x farms and supply.
        if let (3, Ok(code)) = (name.len(), name.parse::<u32>()) {
            return match code {
                410..=419 => Some(Self::Home),
                400..=429 => Some(Self::Office),
                430..=459 => Some(Self::Windowless),
                _ => None,
            };
        }
        USES.iter().find(|(_, words)| words.iter().any(|word| name.contains(word))).map(|(kind, _)| *kind)
    }

    /// Usual height of a storey.
    pub(super) fn storey_m(self) -> f64 {
        if self == Self::Office { 3.6 } else { 2.9 }
    }

    /// Usual width of a bay.
    pub(super) fn bay_m(self) -> f64 {
        if self == Self::Office { 3.6 } else { 3.0 }
    }
}
