//! Which part of a list a request wants: `?limit=` and `?after=`.

use super::problem::Problem;
use insula_protocol::name::is_name;
use std::num::NonZeroUsize;

/// Cities on a page, unless the request says otherwise.
const DEFAULT_LIMIT: NonZeroUsize = NonZeroUsize::new(100).unwrap();
const MAX_LIMIT: usize = 1000;
const INVALID_LIMIT: Problem = Problem::bad_request("limit must be a number from 1 to 1000");

/// Which part of the list of cities a request wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PageRequest<'a> {
    /// Only cities that sort after this name.
    pub(super) after: Option<&'a str>,
    pub(super) limit: NonZeroUsize,
}

impl Default for PageRequest<'_> {
    fn default() -> Self {
        Self { after: None, limit: DEFAULT_LIMIT }
    }
}

/// The page that a query asks for. Other parameters are ignored. Fails with 400 for values that are invalid or given twice.
pub(super) fn page_request(query: &str) -> Result<PageRequest<'_>, Problem> {
    let (mut after, mut limit) = (None, None);
    for (key, value) in query.split('&').map(|pair| pair.split_once('=').unwrap_or((pair, ""))) {
        match key {
            "after" if after.is_none() && is_name(value) => after = Some(value),
            "after" => return Err(Problem::bad_request("after must be the name of a city")),
            "limit" if limit.is_none() => {
                limit = value.parse().ok().filter(|limit: &NonZeroUsize| limit.get() <= MAX_LIMIT);
                limit.ok_or(INVALID_LIMIT)?;
            }
            "limit" => return Err(INVALID_LIMIT),
            _ => {}
        }
    }
    Ok(PageRequest { after, limit: limit.unwrap_or(DEFAULT_LIMIT) })
}
