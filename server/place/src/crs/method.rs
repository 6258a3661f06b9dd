//! Projections by the names that well-known text and PROJJSON have for their methods and parameters.

use super::registry::name_key;

/// What a parameter is for PROJ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    Degrees(&'static str),
    Metres(&'static str),
    Ratio(&'static str),
    /// No meaning for PROJ, such as Esri's scales of the axes of Krovak.
    Other,
}

/// The meaning of a parameter's name.
pub(super) fn meaning(parameter: &str) -> Meaning {
    match &*name_key(parameter) {
        "latitudeoforigin"
        | "latitudeofnaturalorigin"
        | "latitudeoffalseorigin"
        | "latitudeofcenter"
        | "latitudeofcentre"
        | "latitudeofprojectioncentre"
        | "latitudeofprojectioncenter"
        | "latitudeof1stpoint" => Meaning::Degrees("lat_0"),
        "centralmeridian"
        | "longitudeofnaturalorigin"
        | "longitudeoffalseorigin"
        | "longitudeofcenter"
        | "longitudeofcentre"
        | "longitudeofprojectioncentre"
        | "longitudeofprojectioncenter"
        | "longitudeoforigin"
        | "straightverticallongitudefrompole" => Meaning::Degrees("lon_0"),
        "standardparallel1" | "latitudeof1ststandardparallel" | "latitudeofstandardparallel" => {
            Meaning::Degrees("lat_1")
        }
        "standardparallel2" | "latitudeof2ndstandardparallel" => Meaning::Degrees("lat_2"),
        "azimuth" | "azimuthofinitialline" | "azimuthatprojectioncentre" | "colatitudeofconeaxis" => {
            Meaning::Degrees("alpha")
        }
        "rectifiedgridangle" | "anglefromrectifiedtoskewgrid" | "xyplanerotation" => Meaning::Degrees("gamma"),
        "scalefactor"
        | "scalefactoratnaturalorigin"
        | "scalefactoronpseudostandardparallel"
        | "scalefactoroninitialline"
        | "scalefactoratprojectioncentre" => Meaning::Ratio("k"),
        "falseeasting" | "eastingatfalseorigin" | "eastingatprojectioncentre" => Meaning::Metres("x_0"),
        "falsenorthing" | "northingatfalseorigin" | "northingatprojectioncentre" => Meaning::Metres("y_0"),
        _ => Meaning::Other,
    }
}

/// Parameters of a projection: degrees, metres and ratios by the names of PROJ.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Parameters(pub(super) Vec<(&'static str, f64)>);

impl Parameters {
    fn get(&self, name: &str) -> Option<f64> {
        self.0.iter().find(|(known, _)| *known == name).map(|(_, value)| *value)
    }

    /// `+name=value` for each of the names that has a value. `old=new` renames.
    fn text(&self, names: &[&str]) -> String {
        let mut text = String::new();
        for name in names {
            let (from, to) = name.split_once('=').unwrap_or((name, name));
            if let Some(value) = self.get(from) {
                text.push_str(&format!(" +{to}={value}"));
            }
        }
        text
    }
}

const FALSE_ORIGIN: [&str; 2] = ["x_0", "y_0"];

/// The projection for PROJ. Fails with the reason if the method is not known.
pub(super) fn projection(method: &str, parameters: &Parameters) -> Result<String, String> {
    let key = name_key(method);
    let text = |projection: &str, names: &[&str]| {
        format!("+proj={projection}{}{}", parameters.text(names), parameters.text(&FALSE_ORIGIN))
    };
    Ok(match &*key {
        "transversemercator"
        | "gausskruger"
        | "transversemercatorcomplex"
        | "transversemercatorsouthorientated"
        | "transversemercatorsouthoriented" => text("tmerc", &["lat_0", "lon_0", "k"]),
        "lambertconformalconic1sp" => text("lcc", &["lat_0=lat_1", "lat_0", "lon_0", "k=k_0"]),
        "lambertconformalconic2sp" | "lambertconicconformal2sp" => text("lcc", &["lat_0", "lon_0", "lat_1", "lat_2"]),
        "lambertconicconformal1sp" | "lambertconicconformalwestorientated" => {
            text("lcc", &["lat_0=lat_1", "lat_0", "lon_0", "k=k_0"])
        }
        "lambertconformalconic2spbelgium" | "lambertconicconformal2spbelgium" => {
            return Err("the projection Lambert Conformal Conic (2SP Belgium) is not supported".to_owned());
        }
        "lambertconformalconic" => lambert(parameters),
        "obliquestereographic" | "doublestereographic" | "obliquestereographicalternative" => {
            text("sterea", &["lat_0", "lon_0", "k"])
        }
        "stereographic" => text("stere", &["lat_0", "lon_0", "k"]),
        "polarstereographic"
        | "polarstereographicvarianta"
        | "polarstereographicvariantb"
        | "stereographicnorthpole"
        | "stereographicsouthpole" => polar_stereographic(parameters),
        "mercator" | "mercator1sp" | "mercator2sp" | "mercatorvarianta" | "mercatorvariantb" => {
            text("merc", &["lat_1=lat_ts", "lon_0", "k"])
        }
        "mercatorauxiliarysphere" | "popularvisualisationpseudomercator" => text("webmerc", &["lon_0"]),
        "albers" | "albersconicequalarea" | "albersequalarea" => text("aea", &["lat_0", "lon_0", "lat_1", "lat_2"]),
        "lambertazimuthalequalarea" => text("laea", &["lat_0", "lon_0"]),
        "swissobliquecylindrical" | "swissobliquemercator" => text("somerc", &["lat_0", "lon_0", "k=k_0"]),
        "krovak" | "krovakobliqueconformalconic" | "krovaknorthorientated" => {
            text("krovak", &["lat_0", "lon_0", "alpha", "k"])
        }
        _ if key.contains("hotineobliquemercator") || key.contains("rectifiedskeworthomorphic") => {
            oblique(&key, parameters)
        }
        "cassini" | "cassinisoldner" => text("cass", &["lat_0", "lon_0"]),
        "equirectangular" | "platecarree" | "equidistantcylindrical" => {
            text("eqc", &["lat_1=lat_ts", "lat_0", "lon_0"])
        }
        "cylindricalequalarea" | "lambertcylindricalequalarea" => text("cea", &["lat_1=lat_ts", "lon_0"]),
        "polyconic" | "americanpolyconic" => text("poly", &["lat_0", "lon_0"]),
        "equidistantconic" => text("eqdc", &["lat_0", "lon_0", "lat_1", "lat_2"]),
        "azimuthalequidistant" => text("aeqd", &["lat_0", "lon_0"]),
        _ => return Err(format!("the projection {method} is not supported")),
    })
}

/// Esri has one name for both variants: with one parallel there is a scale.
fn lambert(parameters: &Parameters) -> String {
    let origin = parameters.text(&FALSE_ORIGIN);
    match parameters.get("lat_2") {
        Some(_) => format!("+proj=lcc{}{origin}", parameters.text(&["lat_0", "lon_0", "lat_1", "lat_2", "k=k_0"])),
        None => {
            let first = if parameters.get("lat_1").is_some() { "lat_1" } else { "lat_0=lat_1" };
            format!("+proj=lcc{}{origin}", parameters.text(&[first, "lat_0", "lon_0", "k=k_0"]))
        }
    }
}

/// The latitude is that of the pole with a scale there, or that of true scale.
fn polar_stereographic(parameters: &Parameters) -> String {
    let latitude = parameters.get("lat_1").or_else(|| parameters.get("lat_0")).unwrap_or(90.0);
    let pole = 90.0_f64.copysign(latitude);
    format!(
        "+proj=stere +lat_0={pole} +lat_ts={latitude}{}{}",
        parameters.text(&["lon_0", "k"]),
        parameters.text(&FALSE_ORIGIN)
    )
}

/// An azimuth of 90 degrees is the Swiss variant.
fn oblique(key: &str, parameters: &Parameters) -> String {
    let is_right = |angle: Option<f64>| angle.is_none_or(|angle| (angle - 90.0).abs() < 1e-9);
    if parameters.get("alpha").is_some() && is_right(parameters.get("alpha")) && is_right(parameters.get("gamma")) {
        let names = ["lat_0", "lon_0", "k=k_0", "x_0", "y_0"];
        return format!("+proj=somerc{}", parameters.text(&names));
    }
    // Variant A counts from where the line crosses the equator.
    let is_a = key.ends_with("varianta") || key.ends_with("naturalorigin") || key == "hotineobliquemercator";
    let names = ["lat_0", "lon_0=lonc", "alpha", "gamma", "k", "x_0", "y_0"];
    format!("+proj=omerc{}{}", if is_a { " +no_uoff" } else { "" }, parameters.text(&names))
}
