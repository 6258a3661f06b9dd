//! Names of attributes that tell heights: one table for all readers, in the languages of the larger publishers.

use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::units::{FOOT_M, metres_of};
use std::collections::HashMap;
use std::sync::OnceLock;

/// What an attribute tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum HeightRole {
    /// Height of the top above the ground.
    Top,
    /// Height of the top above sea level.
    Elevation,
    /// Height of the ground above sea level.
    Ground,
    /// Number of storeys above the ground.
    Levels,
}

/// Names without case, marks and what separates words, by role, best first.
static NAMES: [(HeightRole, &str); 4] = [
    (
        HeightRole::Top,
        "height buildingheight measuredheight bldgheight bldght bldghgt bldheight bldht bldhgt bheight bldgh hoehe hohe \
         gebaeudehoehe gebaudehohe objekthoehe gesamthoehe hauteur hauteurbatiment hautbati altura alturaedificio \
         altezza altezzaedificio unvolav hoogte gebouwhoogte hojde hoejde bygningshojde bygningshoejde hoyde hoeyde \
         bygningshoyde hojd hoejd byggnadshojd korkeus korgus augstums aukstis wysokosc wysokoscbudynku vyska vyskabudovy \
         visina magassag inaltime yukseklik binayukseklik ypsos высота высотаздания 高さ 建物高さ 计测高度 計測高さ 高度 \
         建筑高度 建築高度 樓高 높이 건물높이 heit tinggi tinggibangunan hgt heightroof heightagl hgtagl heightaboveground \
         relhmax relheightmax maxheight heightmax maxht maxhgt hgtmax hoehemax hauteurmax meanheight heightmean avgheight \
         heightavg avght meanht hgtmean medianheight heightmedian medianhgt hgtmedian relh2 approxhgt estheight \
         estimatedheight heightest renderheight totalheight topheight heighttop hght gebhoehe hoehegeb alturamax \
         alturamedia alturatotal hautmax hauteurmoyenne hauteurmoy hautmoy altezzamax altezzamedia altezzavolume \
         p95height heightp95 hgebouw ridgeheight firsthoehe nokhoogte eaveheight eavesheight eaveht traufhoehe goothoogte \
         treeheight baumhoehe baumhohe boomhoogte hauteurarbre alturaarbol avghgt meanhgt medhgt medheight hmax hmean \
         hmedian altezzagronda altgronda hautbat hauteurbat bathauteur structureheight structheight structurehgt buheight \
         visinaobjekta chieucao висота височина висина ύψος υψος גובה ارتفاع الارتفاع",
    ),
    (
        HeightRole::Elevation,
        "hdakmax hdak70p hdak50p b3hdakmax b3hdak70p b3hdak50p b3hdakm b3hdak7 b3hdak5 zmaxtoit dachmax roofelev \
         roofelevation roofz zroof topelev topelevation bldgelev abshmax absh2",
    ),
    (
        HeightRole::Ground,
        "hmaaiveld b3hmaaiveld groundelev groundelevation groundz zground zminsol gelaendepunkt gelandepunkt \
         gelaendehoehe gelandehohe grndelev gndelev baseelev baseelevation abshmin",
    ),
    (
        HeightRole::Levels,
        "buildinglevels levels numfloors floors numberoffloors numberoffloorsaboveground nofloors nooffloors floorcount \
         nfloors floorsno buildingfloors storeys stories storeysaboveground storiesaboveground numstoreys numstories \
         nostoreys nostories noofstoreys noofstories numberofstoreys numberofstories nstoreys nstories bldgstory \
         bldgstories anzahlderoberirdischengeschosse anzahlgeschosse oberirdischegeschosse geschosse geschosszahl \
         stockwerke anzstock nombredetages nbetages nbetage etages plantas numplantas nplantas pisos numpisos npisos \
         numeropisos pavimentos numpavimentos numpiani npiani numeropiani piani bouwlagen aantalbouwlagen verdiepingen \
         aantalverdiepingen etager antaletager byg054antaletager etasjer antalletasjer antalletasje vaningar \
         antalvaningar kerrosluku kerrostenlkm korruselisus korrused stavai kondygnacje liczbakondygnacji lkond \
         pocetpodlazi podlazi szintek katsayisi katadedi bldglevels numlevels levelcount anzahlgs aog \
         plantassobrerasante numplantassobrerasante andares numandares kondygnacjenadziemne kerroslkm korrustearv \
         maxkorrustearv этажность этажей количествоэтажей 階数 地上階数 層数 层数 層數 楼层数 \
         地上层数 지상층수 grofloco jumlahlantai anzgeschosse anzgesch vollgeschosse anzahlvollgeschosse stockwerkzahl \
         stockwerkszahl anzahlstockwerke etagen anzetagen anzahletagen niveaux nbniveaux nbniv nombreniveaux floorsabv \
         floorsag floorsaboveground abovegroundfloors numfloorsaboveground levelsaboveground abovegroundlevels \
         storeycount storycount storeysag nrkondygnacji antallplan antalplan vaningsantal nbniveau niveles numniveles \
         nroniveles cantidadpisos cantpisos nropisos nopisos numberoflevels nolevels kerroslukumaara sotang 층수 קומות \
         поверховість",
    ),
];
/// Namespaces of XML before a name.
const NAMESPACES: [&str; 5] = ["bldg:", "con:", "bu-base:", "bu-core2d:", "bu-core3d:"];
/// Names whose publishers mean feet, with attributes that tell those publishers: the buildings of New York.
const FEET: &[&str] = &["heightroof"];
const OF_NEW_YORK: &[&str] = &["groundelev", "cnstrctyr", "basebbl", "mplutobbl", "mpplutobbl", "doittid", "bin"];
/// The limit for vehicles in OpenStreetMap.
const OF_VEHICLES: &str = "maxheight";
/// Longer names are none of these.
const MAX_NAME_BYTES: usize = 64;
/// Shapefiles cut names to this length; a beginning of this length of a longer name counts.
const CUT_BYTES: usize = 10;
const LEAST_CUT_KEY: usize = 8;
/// A beginning that says nothing of what is counted.
const SAYS_NOTHING: &str = "numberof";
/// End of the name of a number that an object has beside its unit.
const VALUE: &str = ".value";
/// End of the name of the first number of a list.
pub(super) const FIRST: &str = ".0";
/// Names, or their ends, of attributes that tell a unit.
const UNIT_WORDS: [&str; 5] = ["unit", "units", "uom", "unitofmeasure", "unitcode"];
/// Ends of names that tell their unit.
const UNIT_ENDS: [&str; 10] = ["metres", "meters", "feet", "inch", "usft", "mm", "cm", "dm", "ft", "m"];

/// An attribute that tells a height.
#[derive(Debug, Clone, Copy)]
pub(super) struct NamedHeight<'a> {
    pub(super) role: HeightRole,
    rank: usize,
    pub(super) name: &'a str,
    pub(super) value: &'a AttributeValue,
    /// Metres in the unit that the name, or an attribute beside it, tells.
    pub(super) unit_m: Option<f64>,
    /// Where the unit is from, if that is a guess: from the publisher, or from an attribute that may be of another one.
    pub(super) unit_guess: Option<UnitGuess<'a>>,
}

/// Where a unit is from that nothing tells for certain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum UnitGuess<'a> {
    Publisher,
    /// The name of the attribute, and its text.
    Beside(&'a str, &'a str),
    /// The same of one that tells an unknown unit.
    Unknown(&'a str, &'a str),
}

/// All attributes that tell heights, best first within their role. Units are not guessed where the user gives one.
pub(super) fn find(attributes: &Attributes, is_unit_given: bool) -> Vec<NamedHeight<'_>> {
    let mut found: Vec<NamedHeight<'_>> = attributes
        .iter()
        .filter_map(|(name, value)| {
            let (role, rank, unit_m) = look_up(name)?;
            Some(NamedHeight { role, rank, name, value, unit_m, unit_guess: None })
        })
        .collect();
    found.sort_by_key(|height| height.rank);
    let is_roof = |name: &str| {
        let key = key(name);
        let is_cut = name.len() == CUT_BYTES && key.len() >= LEAST_CUT_KEY;
        FEET.iter().any(|known| *known == key || is_cut && known.starts_with(&*key))
    };
    let is_of_new_york = found.iter().any(|height| is_roof(height.name))
        && attributes.iter().any(|(name, _)| OF_NEW_YORK.contains(&&*key(name)));
    for height in &mut found {
        if height.unit_m.is_some() || height.role == HeightRole::Levels {
            continue;
        }
        let is_roof = is_roof(height.name);
        let own = own_units(attributes, height.name);
        if let Some(unit_m) = own.iter().find_map(|(_, unit)| metres_of(unit)) {
            height.unit_m = Some(unit_m);
        } else if is_unit_given {
            // It counts.
        } else if (is_roof || height.role == HeightRole::Ground) && is_of_new_york {
            // That publisher gives the ground in feet, too.
            (height.unit_m, height.unit_guess) = (Some(FOOT_M), is_roof.then_some(UnitGuess::Publisher));
        } else if let Some((name, unit, unit_m)) = unit_beside(attributes) {
            (height.unit_m, height.unit_guess) = (Some(unit_m), Some(UnitGuess::Beside(name, unit)));
        } else if let Some((name, unit)) = own.first().copied() {
            height.unit_guess = Some(UnitGuess::Unknown(name, unit));
        }
    }
    found
}

/// Names and texts of the attributes that tell the unit of a height, such as `height_unit`.
fn own_units<'a>(attributes: &'a Attributes, height: &str) -> Vec<(&'a str, &'a str)> {
    let height = height.strip_suffix(VALUE).unwrap_or(height);
    let key = key(height);
    let is_of_it = |name: &str| {
        let name = self::key(name);
        let end = name.strip_prefix(&*key).or_else(|| name.strip_prefix("height"));
        end.is_some_and(|end| UNIT_WORDS.contains(&end))
    };
    let units = attributes.iter().filter(|(name, _)| is_of_it(name));
    units.filter_map(|(name, unit)| Some((name, unit.as_str()?))).filter(|(_, unit)| !unit.trim().is_empty()).collect()
}

/// An attribute that tells a unit of length, perhaps that of a height: its name, its text, and metres in it. Metres need not be told.
fn unit_beside(attributes: &Attributes) -> Option<(&str, &str, f64)> {
    let units = attributes.iter().filter(|(name, _)| UNIT_WORDS.contains(&&*key(name)));
    units
        .filter_map(|(name, unit)| Some((name, unit.as_str()?, metres_of(unit.as_str()?)?)))
        .find(|(.., unit_m)| *unit_m != 1.0)
}

/// Whether a word such as `floors` says that storeys are counted.
pub(super) fn counts_storeys(word: &str) -> bool {
    let is_known = |word: &str| look_up(word).is_some_and(|(role, ..)| role == HeightRole::Levels);
    is_known(word) || is_known(&format!("{}s", word.trim_end_matches('.')))
}

/// Whether a name is that of a height above the ground.
pub fn is_height(name: &str) -> bool {
    look_up(name).is_some_and(|(role, ..)| role == HeightRole::Top)
}

/// Metres in the unit that the end of a name tells, as in `HEIGHT_FT` and `height (m)`.
pub(super) fn unit_of_name(name: &str) -> Option<f64> {
    let mut words = name.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
    let last = words.next_back()?;
    words.next()?;
    metres_of(last)
}

/// Metres in the unit at the end of a name, as in `min_height_ft`, if the rest is one of the names.
pub(super) fn unit_after(name: &str, names: &[&str]) -> Option<f64> {
    let bare = name.trim_end_matches(|c: char| !c.is_alphanumeric());
    let tail = |bytes: usize| bare.len().checked_sub(bytes).and_then(|start| bare.get(start..));
    let ends_with = |end: &&str| tail(end.len()).is_some_and(|tail| tail.eq_ignore_ascii_case(end));
    // Most names have no unit. They cost little.
    if name.len() > MAX_NAME_BYTES || !UNIT_ENDS.iter().any(ends_with) {
        return None;
    }
    let key = key(name);
    names.iter().find_map(|known| {
        let end = key.strip_prefix(&*self::key(known))?;
        let is_unit = |end: &&str| UNIT_ENDS.contains(end);
        // `min_height_in_ft`, too.
        Some(end).filter(is_unit).or_else(|| end.strip_prefix("in").filter(is_unit)).and_then(metres_of)
    })
}

/// Role, rank and unit of a name.
fn look_up(name: &str) -> Option<(HeightRole, usize, Option<f64>)> {
    static TABLE: OnceLock<HashMap<&str, (HeightRole, usize)>> = OnceLock::new();
    if name.len() > MAX_NAME_BYTES || name == OF_VEHICLES {
        return None;
    }
    let table = TABLE.get_or_init(|| {
        let rows = NAMES.iter().flat_map(|(role, names)| names.split_whitespace().map(move |name| (*role, name)));
        rows.enumerate().map(|(rank, (role, name))| (name, (role, rank))).collect()
    });
    let name = [VALUE, FIRST].into_iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name);
    let key = key(NAMESPACES.iter().find_map(|namespace| name.strip_prefix(namespace)).unwrap_or(name));
    if let Some((role, rank)) = table.get(&*key) {
        return Some((*role, *rank, None));
    }
    for end in UNIT_ENDS {
        // `height_in_m`, too.
        let rest = key.strip_suffix(end);
        let known = rest.and_then(|rest| table.get(rest).or_else(|| table.get(rest.strip_suffix("in")?)));
        if let Some((role, rank)) = known.filter(|(role, _)| *role != HeightRole::Levels) {
            return Some((*role, *rank, metres_of(end)));
        }
    }
    if name.len() == CUT_BYTES && key.len() >= LEAST_CUT_KEY && key != SAYS_NOTHING {
        let cut = table.iter().filter(|(known, _)| known.len() > key.len() && known.starts_with(&*key));
        return cut.min_by_key(|(_, (_, rank))| *rank).map(|(_, (role, rank))| (*role, *rank, None));
    }
    None
}

/// A name in lower case, without marks on letters and without what separates words.
fn key(name: &str) -> String {
    let letters = name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase);
    let mut key = String::with_capacity(name.len());
    for letter in letters {
        match letter {
            'á' | 'à' | 'â' | 'ä' | 'ã' | 'å' | 'ą' | 'ā' => key.push('a'),
            'é' | 'è' | 'ê' | 'ë' | 'ę' | 'ě' | 'ē' => key.push('e'),
            'í' | 'ì' | 'î' | 'ï' | 'ī' | 'ı' => key.push('i'),
            'ó' | 'ò' | 'ô' | 'ö' | 'õ' | 'ő' | 'ø' => key.push('o'),
            'ú' | 'ù' | 'û' | 'ü' | 'ű' | 'ů' | 'ū' => key.push('u'),
            'ý' => key.push('y'),
            'ç' | 'ć' | 'č' => key.push('c'),
            'ñ' | 'ń' => key.push('n'),
            'š' | 'ś' | 'ş' | 'ș' => key.push('s'),
            'ž' | 'ź' | 'ż' => key.push('z'),
            'ł' => key.push('l'),
            'ř' => key.push('r'),
            'æ' => key.push_str("ae"),
            'ß' => key.push_str("ss"),
            // A dot above that the lower case of the Turkish I leaves.
            '\u{307}' => {}
            letter => key.push(letter),
        }
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_known_in_any_case_and_language() {
        let role = |name: &str| look_up(name).map(|(role, _, unit_m)| (role, unit_m));
        for name in "HEIGHT Height hoehe Höhe HOEHE hauteur Altura BLDG_HT heightroof measuredHe building_height \
            building_h building:height Gebäudehöhe výška wysokość høyde 高さ max_height HGT_AGL AVG_HGT H_MAX \
            HAUT_BAT Altezza_Gronda Ύψος ВИСОТА ارتفاع"
            .split(' ')
        {
            assert_eq!(role(name), Some((HeightRole::Top, None)), "{name}");
        }
        for name in "STOREYS building:levels NUM_FLOORS storeysAboveGround building_l 階数 nb_étages ANZ_GESCH \
            antal_plan NIVELES 층수"
            .split(' ')
        {
            assert_eq!(role(name), Some((HeightRole::Levels, None)), "{name}");
        }
        assert_eq!(role("HEIGHT_FT"), Some((HeightRole::Top, Some(FOOT_M))));
        assert_eq!(role("height (m)"), Some((HeightRole::Top, Some(1.0))));
        assert_eq!(role("hgt_maxcm"), Some((HeightRole::Top, Some(0.01))));
        assert_eq!(role("HEIGHT_MM"), Some((HeightRole::Top, Some(0.001))));
        assert_eq!(role("HeightUSft").map(|(_, unit_m)| unit_m), Some(Some(insula_source::units::US_FOOT_M)));
        for name in ["b3_h_dak_max", "b3_h_dak_m", "b3_h_dak_7"] {
            assert_eq!(role(name), Some((HeightRole::Elevation, None)), "{name}");
        }
        assert_eq!(role("b3_h_maaiv"), Some((HeightRole::Ground, None)));
        assert_eq!(role("Baumhöhe"), Some((HeightRole::Top, None)));
        assert_eq!(role("H_MAAIVELD"), Some((HeightRole::Ground, None)));
        // Limits for vehicles, parts of a roof, a place within a building.
        for name in [
            "maxheight", "roof:height", "roof_height", "min_height", "level", "floor", "number_of_", "ele", "width", "",
        ] {
            assert_eq!(role(name), None, "{name}");
        }
        let base_unit = |name: &str| unit_after(name, &["min_height", "base_height"]);
        assert_eq!((base_unit("MIN_HEIGHT_FT"), base_unit("base height (m)")), (Some(FOOT_M), Some(1.0)));
        assert_eq!(
            (base_unit("min_height_in_cm"), base_unit("min_height"), base_unit("height_ft")),
            (Some(0.01), None, None)
        );
        assert_eq!((unit_of_name("H_FT"), unit_of_name("ft"), unit_of_name("H")), (Some(FOOT_M), None, None));
    }
}
