//! Inputs that give nothing to the city: they cannot be read, or all of their objects are left out.
//!
//! A bake fails because of one. If bad inputs are skipped, it goes on as if they had not been given, and reports them.

use insula_dress::footprint::{ENDED, HAZARD};
use insula_source::error::InputError;
use insula_source::problems::{FAR, FEW_CORNERS, REMOVED};
use insula_source::report::{BadInput, SourceReport};

/// What to do if rings in a declared system have no size.
pub(super) const TOO_SMALL: &str =
    "check the coordinate system that it declares, because degrees that are declared as metres give such rings";

/// Decides what becomes of bad inputs, and collects those that are skipped.
pub(super) struct BadInputs {
    is_skipping: bool,
    found: Vec<BadInput>,
    first: Option<InputError>,
}

impl BadInputs {
    pub(super) fn new(is_skipping: bool) -> Self {
        Self { is_skipping, found: Vec::new(), first: None }
    }

    /// Notes the bad input at `path`. Fails with its error unless bad inputs are skipped.
    pub(super) fn add(&mut self, path: &str, error: InputError) -> Result<(), InputError> {
        if !self.is_skipping {
            return Err(error);
        }
        let text = error.to_string();
        let reason = text.strip_prefix(path).and_then(|rest| rest.strip_prefix(": ")).unwrap_or(&text).to_owned();
        self.found.push(BadInput { path: path.to_owned(), reason });
        self.first.get_or_insert(error);
        Ok(())
    }

    /// The value of a result; `None` if it is the error of a bad input that is skipped. Fails with an error that is not
    /// skipped.
    pub(super) fn skip<T>(&mut self, path: &str, result: Result<T, InputError>) -> Result<Option<T>, InputError> {
        result.map_or_else(|error| self.add(path, error).map(|()| None), |value| Ok(Some(value)))
    }

    pub(super) fn fail_with_first(&mut self) -> Result<(), InputError> {
        self.first.take().map_or(Ok(()), Err)
    }

    pub(super) fn into_found(self) -> Vec<BadInput> {
        self.found
    }
}

/// The error of a source of which every object is left out; `None` if it has others, or none at all, or if a proposal removes them. What has
/// ended, and hazard maps, are delivered with the city: they are an error only where the source `is_alone`.
pub(super) fn nothing_left(source: &SourceReport, is_alone: bool) -> Option<InputError> {
    let objects = source.skipped.values().map(|fault| fault.count).sum();
    if source.objects + source.painted > 0 || objects == 0 || source.skipped.contains_key(REMOVED) {
        return None;
    }
    let (reason, fault) = source.skipped.iter().max_by_key(|(_, fault)| fault.count)?;
    if !is_alone && [ENDED, HAZARD].contains(&reason.as_str()) {
        return None;
    }
    let example = fault.first.first().map(|first| format!(" ({first})")).unwrap_or_default();
    let advice = match reason.as_str() {
        FAR => "check its coordinate system and its units",
        FEW_CORNERS if source.crs.is_some() => TOO_SMALL,
        ENDED => "give what is valid now, or leave out the attribute that ends all",
        _ => "repair it",
    };
    Some(InputError::NothingLeft { path: source.path.clone(), objects, reason: format!("{reason}{example}"), advice })
}
