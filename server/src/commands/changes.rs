//! `changes`: what was built, demolished and changed from one city to another.

use super::error::CommandError;
use super::export::{check_table, plane_of};
use super::output::print_result;
use crate::args::ChangesArgs;
use crate::store::{CityStore, StoredCity, StoredObjects};
use insula_bake::read::EarthPlace;
use insula_command_line::output::Outputs;
use insula_export::changes::{ChangeOptions, ChangeReport, manifest_of_both, write_changes};
use insula_export::format::Projections;
use insula_protocol::Manifest;
use insula_protocol::text::{count, human_bytes, printable};
use serde_json::json;

/// Runs `changes`. Fails if a city cannot be read, if both have no coordinate system in common, if the area is beyond both, or if the
/// table cannot be written.
pub(super) fn run(args: &ChangesArgs) -> Result<(), CommandError> {
    let format = args.format().map_err(CommandError::Usage)?;
    let (before, after) = (CityStore::open(&args.before)?, CityStore::open(&args.after)?);
    let manifests = [before.manifest(), after.manifest()];
    let mut outputs = Outputs::new(args.overwrite).reading([&args.before, &args.after]);
    check_table(&mut outputs, format, &manifest_of_both(manifests[0], manifests[1]), &args.out)?;
    let systems = manifests.map(|manifest| manifest.crs.as_deref());
    let places = systems.map(|system| system.and_then(EarthPlace::of));
    let [from, to] = [places[0].as_ref(), places[1].as_ref()];
    let (is_one_map, note) = check_systems(args, systems, [from, to])?;
    let on_map = |place: [f64; 2]| if is_one_map { Some(place) } else { to?.on_map(from?.lon_lat(place)?) };

    let [objects_before, objects_after] = [StoredObjects::open(&before)?, StoredObjects::open(&after)?];
    let read_before = |kind, id| before.tile(kind, id);
    let read_after = |kind, id| after.tile(kind, id);
    let earlier = StoredCity::new(manifests[0], objects_before.schema(), &read_before);
    let later = StoredCity::new(manifests[1], objects_after.schema(), &read_after);

    let area = |place: Option<&EarthPlace>| {
        args.area.world_box(|degrees| place?.box_on_map(degrees)).map_err(CommandError::Usage)
    };
    let areas = area(from)?.zip(area(to)?).map(|(before, after)| [before, after]);
    if let Some([in_before, in_after]) = areas {
        let beyond = |area, manifest: &Manifest, place: Option<&EarthPlace>| {
            let city = manifest.bounds.map(|[x, y, _]| [x, y]);
            args.area.beyond(area, city, &|at| place?.lon_lat(at))
        };
        // One city alone may have grown into the area.
        if let (Some(_), Some(reason)) = (beyond(in_before, manifests[0], from), beyond(in_after, manifests[1], to)) {
            return Err(CommandError::Usage(reason));
        }
    }
    let schemas = [objects_before.schema(), objects_after.schema()];
    let is_unknown = |name: &&String| schemas.iter().all(|schema| schema.index_of(name).is_none());
    if let Some(name) = args.attribute.iter().find(is_unknown) {
        let reason = "neither city has it; `insula-server objects CITY` lists the attributes";
        return Err(CommandError::Usage(format!("--attribute {}: {reason}", printable(name))));
    }
    let options = ChangeOptions {
        height_step_m: args.height_step,
        same_footprint: args.same_footprint,
        areas,
        has_unchanged: args.all,
        attributes: args.attribute.clone(),
    };
    let to_lon_lat = |place: [f64; 2]| to?.lon_lat(place);
    let definition = to.and_then(plane_of);
    let projections = Projections {
        to_lon_lat: to.is_some().then_some(&to_lon_lat as _),
        epsg: to.and_then(EarthPlace::epsg),
        definition: definition.as_ref(),
    };
    let changes = write_changes([&earlier, &later], &on_map, &options, (format, &projections), &args.out);
    report(args, &changes.map_err(|error| CommandError::file(&args.out, error))?, note);
    Ok(())
}

/// Whether two cities have one map, and what to note of that. Fails if places of one cannot be brought onto that of the other.
fn check_systems(
    args: &ChangesArgs,
    [before, after]: [Option<&str>; 2],
    places: [Option<&EarthPlace>; 2],
) -> Result<(bool, Option<String>), CommandError> {
    let (first, second) = (args.before.display(), args.after.display());
    if before.or(after).is_none() {
        let note = format!("{first} and {second} are both in metres of their own, which are taken as the same");
        return Ok((true, Some(note)));
    }
    let codes = places.map(|place| place.and_then(EarthPlace::epsg));
    if before == after || codes[0].is_some() && codes[0] == codes[1] {
        return Ok((true, None));
    }
    let named = |system: Option<&str>| printable(system.unwrap_or("metres of its own")).to_string();
    let (from, to) = (named(before), named(after));
    if places.iter().any(Option::is_none) {
        return Err(CommandError::Usage(format!(
            "{first} is in {from}, and {second} in {to}, which cannot be brought together: bake both with the same --crs"
        )));
    }
    if args.area.bbox_metres.is_some() {
        let reason = "--bbox-metres: the cities have two coordinate systems: give --bbox";
        return Err(CommandError::Usage(reason.to_owned()));
    }
    let note = format!("{first} is in {from} and compared in {to}, which may shift it by about a metre");
    Ok((false, Some(note)))
}

/// Says what changed, after what is to note of the cities' maps.
fn report(args: &ChangesArgs, changes: &ChangeReport, of_maps: Option<String>) {
    let ChangeReport {
        built,
        demolished,
        changed,
        unchanged,
        higher,
        lower,
        footprint,
        split,
        merged,
        attributes,
        table,
    } = changes;
    let left_out =
        table.skipped.iter().map(|(reason, number)| format!("{} left out: {reason}", count(*number, "building")));
    let mut notes: Vec<String> = of_maps.into_iter().chain(left_out).chain(table.warnings.iter().cloned()).collect();
    if changed + unchanged == 0 && built * demolished > 0 {
        notes.push("no building of one city is where one of the other is: are both of one place?".to_owned());
    }
    notes.iter().for_each(|note| eprintln!("note: {}", printable(note)));
    if !table.attribution.is_empty() {
        eprintln!("note: name the source wherever this is shown: {}", printable(&table.attribution));
    }
    let facts = json!({
        "out": args.out.display().to_string(),
        "rows": table.objects,
        "bytes": table.bytes,
        "built": built,
        "demolished": demolished,
        "changed": changed,
        "unchanged": unchanged,
        "higher": higher,
        "lower": lower,
        "footprint": footprint,
        "split": split,
        "merged": merged,
        "attributes": attributes,
        "notes": notes,
    });
    let others = match args.attribute.is_empty() {
        true => String::new(),
        false => format!(", {attributes} with other attributes"),
    };
    let text = format!(
        "wrote {} ({}, {}): {} built, {demolished} demolished, {changed} changed ({higher} higher, {lower} lower, {footprint} with \
         another footprint, {split} split, {merged} merged{others}), {unchanged} unchanged\n",
        args.out.display(),
        count(table.objects, "row"),
        human_bytes(table.bytes),
        count(*built, "building"),
    );
    print_result(args.json, &facts, &text);
}
