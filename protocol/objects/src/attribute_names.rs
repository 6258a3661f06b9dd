//! What attributes tell by their names, in the languages of common sources: which texts are searched, and in which order attributes
//! are shown.

/// Last parts of the names of attributes that are names of objects, in lower case.
const NAMES: [&str; 20] = [
    "name", "naam", "nom", "nome", "nombre", "namn", "navn", "nazwa", "bezeichnung", "名称", "名前", "alt_name",
    "official_name", "short_name", "local_name", "loc_name", "old_name", "housename", "buildingname", "gebaeudename",
];
/// The same of attributes that are whole addresses. `freeform` is Overture's, `full` OpenStreetMap's `addr:full`.
const ADDRESSES: [&str; 11] = [
    "address", "adresse", "adres", "anschrift", "indirizzo", "full_address", "fulladdress", "freeform", "full", "住所",
    "所在地",
];
/// The same of streets. The numbers of the same group follow them in the text. `thoroughfare` is that of an address in CityGML.
const STREETS: [&str; 9] = [
    "street", "streetname", "street_name", "straat", "straatnaam", "strasse", "straße", "strassenname", "thoroughfare",
];
/// The same of numbers of houses.
const NUMBERS: [&str; 12] = [
    "housenumber", "house_number", "streetnumber", "street_number", "number", "huisnummer", "huisletter",
    "huisnummertoevoeging", "hausnummer", "hausnummerzusatz", "thoroughfarenumber", "premisenumber",
];
/// Group of `addr:full`: elsewhere `full` is no address.
const OSM_ADDRESS: &str = "addr:";

/// The part that a value has in a text of several values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextPart {
    Street,
    Number,
    /// The town or quarter of an address in CityGML. In Japan it is the whole address.
    Locality,
}

/// What the values of an attribute are for the search.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextUse {
    /// Each value is a text.
    pub is_text: bool,
    pub part: Option<TextPart>,
    /// What precedes the last part of the attribute's name, in lower case. Values of the same group are of one address.
    pub group: String,
    /// Whether it is a name of the object.
    is_name: bool,
}

impl TextUse {
    /// The use by an attribute's name. Lists (`name.1`) count as their members.
    pub fn of_name(name: &str) -> Self {
        let lower = name.to_lowercase();
        let trimmed = lower.trim_end_matches(|letter: char| letter.is_ascii_digit());
        let whole = if trimmed.len() < lower.len() { trimmed.strip_suffix('.').unwrap_or(&lower) } else { &lower };
        let (group, leaf) = whole.split_at(whole.rfind(['.', ':']).map_or(0, |at| at + 1));
        let part = match leaf {
            _ if STREETS.contains(&leaf) => Some(TextPart::Street),
            _ if NUMBERS.contains(&leaf) => Some(TextPart::Number),
            "locality" if is_address(group) => Some(TextPart::Locality),
            _ => None,
        };
        let is_address = ADDRESSES.contains(&leaf) && (leaf != "full" || group == OSM_ADDRESS);
        let is_name = is_name(group, leaf);
        Self { is_text: is_address || is_name, part, group: group.to_owned(), is_name }
    }
}

/// Whether an attribute is a name: also `names.primary` (Overture), `name:en` and `names.common.en` in a language.
fn is_name(group: &str, leaf: &str) -> bool {
    let ends_with =
        |end: &str| group.strip_suffix(end).is_some_and(|head| head.is_empty() || head.ends_with(['.', ':']));
    let language = leaf.split(['-', '_']).next().unwrap_or_default();
    let is_language = (2..=3).contains(&language.len()) && language.bytes().all(|byte| byte.is_ascii_lowercase());
    NAMES.contains(&leaf)
        || leaf == "primary" && ends_with("names.")
        || is_language && (ends_with("name:") || ends_with("names.common."))
}

/// Whether a group is an address of CityGML, `address.` or `address.1.`.
fn is_address(group: &str) -> bool {
    group.split('.').any(|part| part.rsplit(':').next() == Some("address"))
}

/// Last parts of the names of attributes for the use of an object, in lower case and without separators.
const USES: [&str; 17] = [
    "function", "usage", "use", "buildinguse", "class", "building", "amenity", "gebruiksdoel", "gebruiksdoelen",
    "nutzung", "gebaeudefunktion", "funktion", "uso", "utilisation", "currentuse", "用途", "建物用途",
];
/// The same of the year in which it was built.
const YEARS: [&str; 19] = [
    "yearofconstruction", "constructionyear", "yearbuilt", "builtyear", "year", "bouwjaar", "oorspronkelijkbouwjaar",
    "baujahr", "anneeconstruction", "anneedeconstruction", "annodicostruzione", "anodeconstruccion", "cnstrctyr",
    "startdate", "constructiondate", "dateofconstruction", "byggeaar", "建築年", "竣工年",
];
/// The same of its height.
const HEIGHTS: [&str; 16] = [
    "measuredheight", "height", "buildingheight", "heightroof", "roofheight", "hoogte", "hoehe", "höhe",
    "gebaeudehoehe", "hauteur", "altura", "altezza", "hoejde", "b3hdakmax", "計測高さ", "高さ",
];

/// What an attribute tells, in the order in which attributes are shown: the telling ones come first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Telling {
    Name,
    Address,
    Use,
    Year,
    Height,
    Other,
}

impl Telling {
    pub(crate) fn of_name(name: &str) -> Self {
        let text = TextUse::of_name(name);
        // A number alone may be that of anything.
        let is_part = text.part == Some(TextPart::Street) || text.part.is_some() && is_address(&text.group);
        let leaf = name.rsplit(['.', ':']).next().unwrap_or_default();
        let key: String = leaf.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect();
        match key.as_str() {
            _ if text.is_name => Self::Name,
            _ if text.is_text || is_part || text.group == OSM_ADDRESS => Self::Address,
            key if USES.contains(&key) => Self::Use,
            key if YEARS.contains(&key) => Self::Year,
            key if HEIGHTS.contains(&key) => Self::Height,
            _ => Self::Other,
        }
    }
}

/// Names of areas and volumes of 3DBAG, by how they begin, with the units of its documentation. Its heights are above sea level.
const OF_3DBAG: [(&str, &str); 4] = [("b3_h_", "m"), ("b3_rmse_", "m"), ("b3_opp_", "m²"), ("b3_volume_", "m³")];
/// A height of New York, which is in feet.
const IN_FEET: &str = "heightroof";

/// The unit that numbers of an attribute have by its name, if heights are in `heights`; `None` if the name says nothing.
pub(crate) fn unit_of_name<'u>(name: &str, heights: &'u str) -> Option<&'u str> {
    let lower = name.to_lowercase();
    if let Some((_, unit)) = OF_3DBAG.iter().find(|(start, _)| lower.starts_with(start)) {
        return Some(unit);
    }
    let is_height = Telling::of_name(name) == Telling::Height && !lower.ends_with(IN_FEET);
    is_height.then_some(heights)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_in_several_spellings() {
        for (name, telling) in [
            ("yearOfConstruction", Telling::Year),
            ("YEAR_BUILT", Telling::Year),
            ("address.1.thoroughfareNumber", Telling::Address),
            ("names.primary", Telling::Name),
            ("建物用途", Telling::Use),
            ("height_source", Telling::Other),
            ("", Telling::Other),
        ] {
            assert_eq!(Telling::of_name(name), telling, "{name}");
        }
    }
}
