//! Units of length by the names that formats have for them.

/// Metres in an international foot.
pub const FOOT_M: f64 = 0.3048;
/// Metres in a foot of the surveys of the United States.
pub const US_FOOT_M: f64 = 1200.0 / 3937.0;

/// Unit in which heights are given by hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeightUnit {
    Metre,
    Decimetre,
    Centimetre,
    Millimetre,
    Foot,
}

impl HeightUnit {
    /// As people read it.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Decimetre => "dm",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
            Self::Foot => "ft",
        }
    }

    /// Metres in it.
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Decimetre => 0.1,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
            Self::Foot => FOOT_M,
        }
    }
}

/// Metres in a unit with a name in any spelling: a word (`ft`, `US survey foot`), a URN, or a code of UCUM, Esri or
/// the EPSG registry. `None` if it is not known.
pub fn metres_of(name: &str) -> Option<f64> {
    let last = name.trim().rsplit(['#', ':', '/']).next().unwrap_or_default();
    let key: String = last.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect();
    Some(match &*key {
        "m" | "metre" | "metres" | "meter" | "meters" | "mtr" | "mètre" | "mètres" | "metro" | "metros" | "metri"
        | "м" | "метр" | "метры" | "метров" | "米" | "メートル" | "9001" => 1.0,
        "ft" | "foot" | "feet" | "fti" | "ftint" | "ftintl" | "internationalfoot" | "internationalfeet"
        | "footinternational" | "intlfoot" | "pied" | "pieds" | "pies" | "piedi" | "fuss" | "fuß" | "9002" => FOOT_M,
        "usft" | "ftus" | "fts" | "usfoot" | "usfeet" | "footus" | "ussurveyfoot" | "ussurveyfeet" | "ussurveyft"
        | "surveyfoot" | "surveyfeet" | "footussurvey" | "9003" => US_FOOT_M,
        "in" | "inch" | "inches" | "ini" => 0.0254,
        "usin" | "usinch" => 100.0 / 3937.0,
        "yd" | "yard" | "yards" | "ydi" | "9096" => 0.9144,
        "usyard" => 3600.0 / 3937.0,
        "usmile" => 6_336_000.0 / 3937.0,
        "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => 1e-3,
        "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => 1e-2,
        "dm" | "decimetre" | "decimetres" | "decimeter" | "decimeters" => 0.1,
        "km" | "kilometre" | "kilometres" | "kilometer" | "kilometers" | "9036" => 1e3,
        "clarkefoot" | "9005" => 0.304_797_265_4,
        "clarkeyard" => 0.914_391_796_2,
        "clarkelink" => 0.201_166_195_164,
        "searsfoot" | "9041" => 0.304_799_471_538_676,
        "searsyard" => 0.914_398_414_616_029,
        "searschain" => 20.116_765_121_552_6,
        "sears1922truncatedchain" => 20.116_756,
        "benoit1895bchain" => 20.116_782_494_375_9,
        "indianyard" => 0.914_398_530_744_440,
        "indian1937yard" => 0.914_395_23,
        "goldcoastfoot" | "9094" => 0.304_799_710_181_508,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_known_in_every_spelling() {
        for name in
            ["m", "M", "metre", "urn:ogc:def:uom:UCUM::m", "#m", "urn:ogc:def:uom:EPSG::9001", "Mètres", "м", "米"]
        {
            assert_eq!(metres_of(name), Some(1.0), "{name}");
        }
        for name in ["ft", "Feet", "urn:ogc:def:uom:UCUM::[ft_i]", "foot (international)", "ft_int", "Fuß", "pieds"] {
            assert_eq!(metres_of(name), Some(FOOT_M), "{name}");
        }
        for name in ["US survey foot", "us-ft", "ftUS", "US_survey_foot", "[ft_us]", "us-foot", "foot_us"] {
            assert_eq!(metres_of(name), Some(US_FOOT_M), "{name}");
        }
        assert_eq!((metres_of("cubit"), metres_of(""), metres_of("m2")), (None, None, None));
    }
}
