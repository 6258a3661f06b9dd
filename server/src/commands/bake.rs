//! `bake`: turns city files into a city folder, with a progress bar on a terminal.

use super::addresses::Addresses;
use super::bake_progress::BakeProgress;
use super::error::CommandError;
use super::output::{print_result, write};
use crate::args::{
    BakeArgs, GeneratedFacades, GeneratedGround, LengthUnit, Preference, ReadArgs, UpAxis, VisibilityRenderer,
};
use crate::proposal::Proposal;
use crate::store::{CityStore, StoredCity, StoredObjects};
use crate::{labels, memory};
use insula_archive::file::read_text;
use insula_archive::places::canonical;
use insula_bake::read::{
    AxisOrders, AxisRule, DuplicateOption, EarthPlace, FacadeOption, FeatureKind, HeightUnit, InputError, KindFilter,
    NamePatterns, ObjUpAxis, Palette, PlacingOptions, ProposalOptions, ReadOptions, ReadReport, SurroundingsOptions,
    TerrainOptions, cell_of_monument,
};
use insula_bake::sample::{SampleSettings, VisibilityBackend};
use insula_bake::{BakeError, BakeOptions, BakeReport, GroundOption};
use insula_command_line::output::{FileKind, Outputs, check_new_folder};
use insula_objects::schema::Labels;
use insula_protocol::manifest::Attribution;
use insula_protocol::text::{count, human_bytes, printable, shell_word};
use insula_source::problems::REMOVED;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Default memory of a bake with scans: a block with a million triangles takes 800 MiB.
const MEMORY_OF_SCANS: u64 = 1200 << 20;
/// A longer file of a stone is cut, and refused.
const MAX_STONE_BYTES: u64 = 4096;

/// Runs `bake`: writes the city and the report, and prints a summary. Fails if the bake fails or the report cannot be
/// written.
pub(super) fn run(args: &BakeArgs) -> Result<(), CommandError> {
    let palette = palette(args)?;
    let options = options(args, palette)?;
    if let Some(report) = &args.report {
        check_report(report, args, &options)?;
    }
    check_new_folder(&args.out).map_err(CommandError::Usage)?;
    let progress = BakeProgress::start(&args.out);
    memory::set_limit(options.memory_limit_bytes());
    let result = insula_bake::bake(&options, &progress);
    progress.clear();
    let report = result.map_err(|error| match error {
        BakeError::Option { .. } | BakeError::Out { .. } | BakeError::Inside { .. } => {
            CommandError::Usage(error.to_string())
        }
        BakeError::Read(error) if is_of_one_input(&error, args) => {
            CommandError::Bake(format!("{error}; --skip-bad-inputs bakes the other inputs"))
        }
        error => CommandError::Bake(error.to_string()),
    })?;
    if let Some(path) = &args.report {
        let json = serde_json::to_vec_pretty(&report).map_err(|error| CommandError::write(path, error))?;
        write(path, &json)?;
    }
    unknown_names(&args.read, &report.read).iter().for_each(|warning| eprintln!("warning: {}", printable(warning)));
    let facts = if args.json.json { serde_json::to_value(&report).unwrap_or_default() } else { Value::Null };
    print_result(args.json, &facts, &summary(&report, args));
    Ok(())
}

/// A warning for each attribute that an option names and no object has: one that should be dropped would be published.
pub(super) fn unknown_names(args: &ReadArgs, read: &ReadReport) -> Vec<String> {
    let dropped = args.drop.iter().map(|name| ("--drop", name));
    let named = args.height_field.iter().map(|name| ("--height-field", name));
    let named = named.chain(args.search.iter().map(|name| ("--search", name)));
    let is_known = |option: &str, name: &String| {
        let pattern = NamePatterns::parse(std::slice::from_ref(name)).unwrap_or_default();
        read.may_have_attribute(|known| if option == "--drop" { pattern.contains(known) } else { known == name })
    };
    let unknown = dropped.chain(named).filter(|(option, name)| !is_known(option, name));
    let advice = "no object has such an attribute: check its spelling; `insula-server inspect` lists those of an input";
    unknown.map(|(option, name)| format!("{option} {name}: {advice}")).collect()
}

/// The colours of surfaces. Fails if their file cannot be read.
pub(super) fn palette(args: &BakeArgs) -> Result<Palette, CommandError> {
    match &args.palette {
        Some(value) => Palette::from_option(value).map_err(|error| CommandError::Bake(error.to_string())),
        None => Ok(Palette::default()),
    }
}

/// Whether the error is of one of several inputs, without which the others could be baked.
fn is_of_one_input(error: &InputError, args: &BakeArgs) -> bool {
    let is_of_all = match error {
        InputError::Empty { .. } | InputError::Palette { .. } => true,
        // Of a whole folder.
        InputError::NoSource { .. } | InputError::NotRead { .. } => args.inputs.len() == 1,
        _ => args.inputs.len() == 1 && !args.inputs.iter().any(|input| input.is_dir()),
    };
    !is_of_all && !args.skip_bad_inputs
}

const REPORT: FileKind = FileKind::Json("a report of a bake", &["blocks_baked", "city_bytes"]);

/// Fails if the report would overwrite anything but an earlier report: what the bake reads, or another file.
fn check_report(report: &Path, args: &BakeArgs, options: &BakeOptions) -> Result<(), CommandError> {
    // Neither may exist yet.
    for folder in [args.out.clone(), insula_bake::kept_work::scratch_folder(&args.out)] {
        if canonical(report).starts_with(canonical(&folder)) {
            let reason = format!("it lies in the city's folder {}; write it elsewhere", folder.display());
            return Err(CommandError::Usage(format!("{}: {reason}", report.display())));
        }
    }
    let mut outputs = Outputs::new(args.overwrite).reading(options.read_paths()).creating(&args.out);
    outputs.file(report, REPORT).map_err(CommandError::Usage)
}

/// The kinds of these names. Fails with the names that exist if one does not.
fn kinds(names: &[String]) -> Result<Vec<FeatureKind>, CommandError> {
    let of = |name: &String| {
        let known = FeatureKind::NAMES.iter().find(|(known, _)| known == name);
        known.map(|(_, kind)| *kind).ok_or_else(|| {
            let all = FeatureKind::NAMES.map(|(known, _)| known).join(", ");
            CommandError::Usage(format!("{name}: no kind of objects; the kinds are {all}"))
        })
    };
    names.iter().map(of).collect()
}

/// The kinds that are read. Fails if one does not exist, or if none is left.
fn kind_filter(args: &ReadArgs) -> Result<KindFilter, CommandError> {
    let filter = KindFilter { only: kinds(&args.only)?, skip: kinds(&args.skip)? };
    if !FeatureKind::NAMES.iter().any(|(_, kind)| filter.contains(*kind)) {
        return Err(CommandError::Usage("--only and --skip leave no kind of objects".to_owned()));
    }
    Ok(filter)
}

/// Coordinate systems and places. Fails if an order of coordinates is none.
fn placing(args: &ReadArgs) -> Result<PlacingOptions, CommandError> {
    let rules: Result<Vec<AxisRule>, String> = args.axis_order.iter().map(|text| text.parse()).collect();
    let rules = rules.map_err(|error| CommandError::Usage(format!("--axis-order {error}")))?;
    Ok(PlacingOptions {
        crs: args.crs.clone(),
        grids: args.grids.clone(),
        at: args.at.map(|place| place.0),
        bbox_deg: args.area.bbox,
        bbox_m: args.area.bbox_metres,
        axis_orders: AxisOrders::new(rules),
        is_crs_found: false,
    })
}

/// How inputs are read, of which `inspect` asks for no more. Fails if a kind or an order of coordinates is none.
pub(super) fn read_options(args: &ReadArgs) -> Result<ReadOptions, CommandError> {
    Ok(ReadOptions {
        kinds: kind_filter(args)?,
        placing: placing(args)?,
        height_field: args.height_field.clone(),
        height_unit: args.height_unit.map(|unit| match unit {
            LengthUnit::M => HeightUnit::Metre,
            LengthUnit::Dm => HeightUnit::Decimetre,
            LengthUnit::Cm => HeightUnit::Centimetre,
            LengthUnit::Mm => HeightUnit::Millimetre,
            LengthUnit::Ft => HeightUnit::Foot,
        }),
        nodata: args.nodata,
        duplicates: match args.prefer {
            Some(Preference::Lod) => DuplicateOption::KeepBestLevel,
            None if args.keep_duplicates => DuplicateOption::KeepAll,
            None => DuplicateOption::KeepFirst,
        },
        addresses: Some(Addresses::new(&args.allow_host)),
        follow_links: args.follow_links,
        ..ReadOptions::default()
    })
}

/// The files of the palette, the labels and the stone, whose content becomes part of the options.
pub(super) fn named_files(args: &BakeArgs) -> Vec<PathBuf> {
    let is_word = |palette: &Path| matches!(palette.to_str(), Some("harmonised" | "source"));
    let palette = args.palette.iter().filter(|palette| !is_word(palette)).cloned();
    let stone = args.stone.iter().filter(|stone| is_stone_file(stone)).map(PathBuf::from);
    palette.chain(args.labels.clone()).chain(stone).chain(args.proposal.clone()).collect()
}

/// Whether `--stone` names a file rather than a preset.
fn is_stone_file(value: &str) -> bool {
    Path::new(value).extension().is_some_and(|extension| extension == "json")
}

/// JSON text of a stone: a file's, or that of a preset. Fails if the file cannot be read.
fn stone_of(value: &str) -> Result<String, CommandError> {
    if !is_stone_file(value) {
        return Ok(serde_json::json!({ "preset": value }).to_string());
    }
    let failed = |error: std::io::Error| CommandError::Bake(format!("{value}: {error}"));
    read_text(Path::new(value), MAX_STONE_BYTES).map_err(failed)
}

/// What the proposal changes in the city of which unchanged blocks are reused; `None` without one. Fails if a file, or the city, cannot be
/// read.
fn proposal(args: &BakeArgs) -> Result<Option<ProposalOptions>, CommandError> {
    let Some(folder) = &args.reuse else { return Ok(None) };
    let city = CityStore::open(folder)?;
    let Some(file) = &args.proposal else { return Ok(None) };
    let proposal = Proposal::read(file)?;
    let objects = StoredObjects::open(&city)?;
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::new(city.manifest(), objects.schema(), &read);
    let place = city.manifest().crs.as_deref().and_then(EarthPlace::of);
    let change = proposal.change(&source, place.as_ref())?;
    Ok(Some(change.for_bake(&proposal, &source)?))
}

/// What a bake is asked for. Fails if a file that an option names cannot be read.
pub(super) fn options(args: &BakeArgs, palette: Palette) -> Result<BakeOptions, CommandError> {
    let stone = args.stone.as_deref().map(stone_of).transpose()?;
    let monument = cell_of_monument(&args.inputs, stone.is_some(), args.read.at.map(|place| place.0));
    let is_monument = monument.is_some() && args.landmarks.is_none();
    if stone.is_some() && !is_monument {
        return Err(CommandError::Bake("--stone needs one mesh as the only input; use --landmarks in a city".into()));
    }
    let cell_m = args.cell.or(monument.filter(|_| is_monument)).unwrap_or(1.0);
    let terrain = TerrainOptions {
        error_cells: args.terrain_error.map_or(TerrainOptions::default().error_cells, |error_m| error_m / cell_m),
        margin_m: args.terrain_margin,
        texel_m: args.ground_texel,
        tolerance_m: args.terrain_tolerance,
    };
    let surroundings = SurroundingsOptions { files: args.surroundings.clone(), reach_m: args.surroundings_reach * 1e3 };
    Ok(BakeOptions {
        read: ReadOptions {
            landmarks: args.landmarks.clone(),
            is_monument,
            stone,
            terrain,
            streets: args.streets.clone(),
            surroundings,
            facades: match args.facades {
                GeneratedFacades::Plain => FacadeOption::Plain,
                GeneratedFacades::Windows => FacadeOption::Windows,
            },
            skip_bad_inputs: args.skip_bad_inputs,
            obj_up: match args.obj_up {
                UpAxis::Z => ObjUpAxis::Z,
                UpAxis::Y => ObjUpAxis::Y,
            },
            palette,
            texture_roots: args.texture_root.clone(),
            proposal: proposal(args)?,
            ..read_options(&args.read)?
        },
        drop_attributes: args.read.drop.clone(),
        search_attributes: args.read.search.clone(),
        labels: labels_of(args)?,
        inputs: args.inputs.clone(),
        out: args.out.clone(),
        cell_m,
        // Nobody walks in the streets of a statue.
        street_sets: !args.no_street_sets && !is_monument,
        picture: !args.no_picture,
        quality: args.quality,
        meshes: !args.no_meshes,
        ground: match args.ground {
            // A mesh without a city shows nothing but itself.
            GeneratedGround::Auto if is_monument => GroundOption::None,
            GeneratedGround::Auto => GroundOption::Auto,
            GeneratedGround::None => GroundOption::None,
        },
        threads: args.threads.map(usize::from),
        memory_bytes: args.memory.or((args.landmarks.is_some() || is_monument).then_some(MEMORY_OF_SCANS)),
        scratch_bytes: args.scratch,
        update: args.update,
        reuse: args.reuse.clone(),
        version_of: args.version_of.clone(),
        date: args.date.clone(),
        resume: args.resume,
        name: args.name.clone(),
        title: args.title.clone(),
        place: None,
        attribution: attribution(args),
        named_files: named_files(args),
        sample: SampleSettings {
            visibility: match args.visibility {
                VisibilityRenderer::Cpu => VisibilityBackend::Cpu,
                VisibilityRenderer::Gpu => VisibilityBackend::Gpu,
            },
            ..SampleSettings::with_views(args.views)
        },
    })
}

fn attribution(args: &BakeArgs) -> Vec<Attribution> {
    let of = |text: &String| {
        let (licence, url) = (args.licence.clone(), args.source_url.clone());
        Attribution { text: text.clone(), licence, url }
    };
    args.attribution.iter().map(of).collect()
}

fn labels_of(args: &BakeArgs) -> Result<Labels, CommandError> {
    let read = args.labels.as_deref().map(labels::read).transpose();
    Ok(read.map_err(|error| CommandError::Usage(format!("--labels {error}")))?.unwrap_or_default())
}

fn summary(report: &BakeReport, args: &BakeArgs) -> String {
    let unchanged = match report.blocks_unchanged {
        0 => String::new(),
        n => format!(", {n} of {} blocks unchanged", n + report.blocks_baked + report.blocks_resumed),
    };
    let memory =
        report.peak_memory_bytes.map_or(String::new(), |bytes| format!(", peak memory {}", human_bytes(bytes)));
    let meshes = match report.meshes.first() {
        None => String::new(),
        Some(finest) => {
            let bytes = report.meshes.iter().map(|lod| lod.bytes).sum();
            format!(", meshes of {} leaves ({})", finest.leaves, human_bytes(bytes))
        }
    };
    format!(
        "{}: {}, {} triangles in {:.1} s ({:.0} triangles/s{memory}): {} nodes, {}{meshes}\
         {unchanged}{}\n{}serve it with: insula-server serve {}\n",
        report.name,
        report.size,
        report.triangles,
        report.seconds,
        report.triangles_per_second,
        report.nodes,
        human_bytes(report.city_bytes),
        left_out(&report.read) + &proposed(&report.read),
        filled_in(&report.filled_in),
        shell_word(&args.out.to_string_lossy()),
    )
}

/// What a proposal changed, for the end of a sentence; empty without one.
fn proposed(read: &ReadReport) -> String {
    let Some(proposal) = &read.proposal else { return String::new() };
    let [removed, added] = [proposal.removed, proposal.added].map(|objects| count(objects, "object"));
    format!("; {}: {removed} hidden, {added} added", printable(&proposal.title))
}

/// Lines that say which names and licences were filled in; empty if none.
fn filled_in(lines: &[String]) -> String {
    let line = |line: &String| {
        format!("named by what is known of its publisher: {}; --attribution names another\n", printable(line))
    };
    lines.iter().map(line).collect()
}

/// What of the inputs is not in the city or was guessed, and why: for the end of a sentence, empty if all is.
fn left_out(read: &ReadReport) -> String {
    /// Reasons that are named; `--report` has all.
    const MAX_REASONS: usize = 3;
    let mut text = String::new();
    if !read.bad_inputs.is_empty() {
        text += &format!(", {} left out", count(read.bad_inputs.len() as u64, "input"));
    }
    let mut by_reason = BTreeMap::<&str, u64>::new();
    let skipped = read.sources.iter().flat_map(|source| &source.skipped);
    for (reason, fault) in skipped.filter(|(reason, _)| *reason != REMOVED) {
        *by_reason.entry(reason).or_default() += fault.count;
    }
    let duplicates = read.duplicates();
    if duplicates > 0 {
        text += &format!(", {} left out", count(duplicates, "duplicate"));
    }
    let merged = read.merged();
    if merged > 0 {
        text += &format!(", {} merged into others of the same name", count(merged, "object"));
    }
    if let Some([guessed, all]) = read.guessed_heights() {
        text += &format!(", {guessed} of {all} heights guessed");
    }
    if by_reason.is_empty() {
        return text;
    }
    let skipped: u64 = by_reason.values().sum();
    let mut reasons: Vec<_> = by_reason.into_iter().collect();
    reasons.sort_by_key(|(reason, n)| (std::cmp::Reverse(*n), *reason));
    let named =
        reasons.iter().take(MAX_REASONS).map(|(reason, n)| format!("{n} {reason}")).collect::<Vec<_>>().join(", ");
    let more = if reasons.len() > MAX_REASONS { ", ..." } else { "" };
    text + &format!(", {} skipped: {named}{more} (--report names them)", count(skipped, "object"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Args, ServerCommand};
    use clap::Parser;

    #[test]
    fn attributes_that_no_object_has_are_told() {
        let line = "insula-server bake a --out c --drop own* --drop ownr* --drop HOEHE --search name --search nme --height-field hoehe";
        let ServerCommand::Bake(args) = Args::parse_from(line.split_whitespace()).command else { panic!("no bake") };
        let mut source = insula_bake::read::SourceReport::new("a", insula_bake::read::SourceFormat::GeoJson, 1);
        for name in ["owner", "hoehe", "name"] {
            source.attributes.entry(name.to_owned()).or_default();
        }
        let read = ReadReport { sources: vec![source], ..ReadReport::default() };
        let warnings = unknown_names(&args.read, &read).join("\n");
        assert!(warnings.starts_with("--drop ownr*: no object") && warnings.contains("\n--search nme: "), "{warnings}");
        assert_eq!(warnings.lines().count(), 2, "{warnings}");
    }

    #[test]
    fn arguments_become_bake_options() {
        let line = "insula-server bake a b --out c --cell 0.5 --threads 3 --resume --update --memory 2GiB --name n --title T \
            --attribution A --licence L --source-url U --obj-up y --no-meshes --scratch 3GiB --facades windows --skip-bad-inputs \
            --crs 25832 --axis-order ne --axis-order a/*=en --at 4.3,-52,3 --only building,bridge --skip road --height-field H \
            --height-unit ft --nodata -32767 --prefer lod --bbox -1,2,3,4";
        let ServerCommand::Bake(args) = Args::parse_from(line.split_whitespace()).command else { panic!("no bake") };
        let options = options(&args, Palette::default()).unwrap();
        assert_eq!(options.inputs, [std::path::Path::new("a"), std::path::Path::new("b")]);
        assert_eq!((options.cell_m, options.threads, options.resume), (0.5, Some(3), true));
        let read = &options.read;
        assert!(!options.meshes && read.skip_bad_inputs);
        assert_eq!((options.ground, read.facades), (GroundOption::Auto, FacadeOption::Windows));
        assert_eq!((options.update, options.memory_bytes, options.scratch_bytes), (true, Some(2 << 30), 3 << 30));
        assert_eq!((options.name.as_deref(), options.title.as_deref()), (Some("n"), Some("T")));
        assert_eq!(read.obj_up, ObjUpAxis::Y);
        let PlacingOptions { crs, at, bbox_deg, axis_orders, .. } = &read.placing;
        assert_eq!(*axis_orders, AxisOrders::new(["ne", "a/*=en"].map(|text| text.parse().unwrap())));
        assert_eq!((crs.as_deref(), *at), (Some("EPSG:25832"), Some([4.3, -52.0, 3.0])));
        assert_eq!(*bbox_deg, Some([-1.0, 2.0, 3.0, 4.0]));
        assert!(read.kinds.contains(FeatureKind::BuildingPart) && !read.kinds.contains(FeatureKind::Road));
        assert_eq!((read.height_field.as_deref(), read.duplicates), (Some("H"), DuplicateOption::KeepBestLevel));
        assert_eq!((read.height_unit, read.nodata), (Some(HeightUnit::Foot), Some(-32767.0)));
        let [source] = &options.attribution[..] else { panic!("{:?}", options.attribution) };
        assert_eq!((&*source.text, source.licence.as_deref(), source.url.as_deref()), ("A", Some("L"), Some("U")));
    }
}
