//! Changes a city that is read by a proposal.

use super::bad_inputs::BadInputs;
use super::context::ReadContext;
use super::list::list_mesh;
use super::proposal_options::{AddedContent, AddedInput};
use super::read_source;
use super::sink::SceneSink;
use crate::error::BakeError;
use insula_place::local_frame;
use insula_place::placement::Placement;
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::error::InputError;
use insula_source::object::{FeatureKind, ObjectSink, Shape, SourceObject, TriangleMesh};
use insula_source::report::{ProposalReport, ReadReport, SourceFormat, SourceReport};
use insula_source::source::CitySource;
use insula_source::subject;

/// Leaves out what the options' proposal removes, and reads what it adds; does nothing without one. What is outside of the wanted area, and
/// what sources have twice, is left out before. Fails if a file cannot be read, or if scratch files fail.
pub(super) fn apply(
    context: &mut ReadContext<'_>,
    report: &mut ReadReport,
    set_of_source: &mut Vec<u32>,
) -> Result<(), InputError> {
    let Some(proposal) = &context.options.proposal else { return Ok(()) };
    if let Some([low, high]) = context.wanted_area() {
        context.builder.drop_outside(low, high, &mut report.sources).map_err(failed)?;
    }
    let duplicates = context.options.duplicates;
    context.builder.drop_duplicates(duplicates, &mut report.sources).map_err(failed)?;
    let removed = context.builder.drop_removed(&proposal.removed, &mut report.sources).map_err(failed)?;
    let first = report.sources.len();
    (context.is_last_resort, context.is_addition) = (true, true);
    for input in &proposal.added {
        add(context, input, report, set_of_source)?;
    }
    (context.is_addition, context.addition_place) = (false, None);
    let added = report.sources.iter().skip(first).map(|source| source.objects).sum();
    let (title, missing) = (proposal.title.clone(), proposal.missing.clone());
    report.proposal = Some(ProposalReport { title, removed, added, missing });
    Ok(())
}

fn failed(error: BakeError) -> InputError {
    InputError::io("the objects so far", std::io::Error::other(error))
}

/// Reads an addition.
fn add(
    context: &mut ReadContext<'_>,
    input: &AddedInput,
    report: &mut ReadReport,
    set_of_source: &mut Vec<u32>,
) -> Result<(), InputError> {
    let listed = list_mesh(std::slice::from_ref(&input.file), context.options, &mut BadInputs::new(false))?;
    context.addition_place = match input.content {
        AddedContent::PlacedModel { origin, heading_deg } => Some(local_frame::at(origin, heading_deg)),
        AddedContent::Model { .. } | AddedContent::Block(_) => None,
    };
    let first = context.builder.len();
    for source in &listed.sources {
        context.source = report.sources.len();
        subject::set(format_args!("{}", source.label));
        let read = match &input.content {
            AddedContent::Block(triangles) => Some(add_block(context, source, triangles)?),
            AddedContent::Model { .. } | AddedContent::PlacedModel { .. } => read_source(context, source, &|_| {})?,
        };
        report.sources.extend(read);
        set_of_source.resize(report.sources.len(), context.textures.set_of(source));
    }
    match input.content {
        AddedContent::Model { base_m } => context.builder.lift_from_zero(first, base_m).map_err(failed),
        AddedContent::PlacedModel { .. } | AddedContent::Block(_) => Ok(()),
    }
}

/// Adds a block as a building with the name of the file.
fn add_block(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    triangles: &[[[f64; 3]; 3]],
) -> Result<SourceReport, InputError> {
    let mut sink = SceneSink::new(context, source, SourceFormat::GeoJson, &|_| {})?;
    sink.set_placement(Placement::Unknown);
    let id = source.name.rsplit('/').next().unwrap_or(&source.name).to_owned();
    let mut attributes = Attributes::default();
    attributes.push("name", AttributeValue::Text(id.clone()));
    let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
    let mesh = TriangleMesh {
        positions: triangles.as_flattened().to_vec(),
        triangles: indices.collect(),
        ..TriangleMesh::default()
    };
    sink.add(SourceObject {
        id,
        parent: None,
        kind: FeatureKind::Building,
        source_type: "proposal".to_owned(),
        lod: None,
        attributes,
        shape: Shape::Surfaces { polygons: Vec::new(), meshes: vec![mesh] },
    })?;
    Ok(sink.into_report())
}
