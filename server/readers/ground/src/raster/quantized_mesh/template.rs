//! Names of tiles, as `layer.json` writes them: `{z}/{x}/{y}.terrain?v={version}`.

/// The name of every tile whose `layer.json` says nothing else, and of most others.
pub(super) const USUAL: &str = "{z}/{x}/{y}.terrain";

/// Level, column and row of a tile as its name counts them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NamedTile {
    pub(super) level: u32,
    pub(super) column: u32,
    pub(super) row: u32,
}

/// How tiles are named within the folder of `layer.json`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Template {
    parts: Vec<TemplatePart>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum TemplatePart {
    Text(String),
    Level,
    Column,
    Row,
}

impl Template {
    /// Reads a template. `None` if it lacks a number of the tile, or has a word in braces that is not known.
    pub(super) fn new(text: &str, version: &str) -> Option<Self> {
        let mut rest = path_of(text);
        let mut parts = Vec::new();
        while let Some((before, after)) = rest.split_once('{') {
            let (word, after) = after.split_once('}')?;
            parts.push(TemplatePart::Text(before.to_owned()));
            parts.push(match word {
                "z" => TemplatePart::Level,
                "x" => TemplatePart::Column,
                "y" => TemplatePart::Row,
                "version" => TemplatePart::Text(version.to_owned()),
                _ => return None,
            });
            rest = after;
        }
        parts.push(TemplatePart::Text(rest.to_owned()));
        let has_all =
            [TemplatePart::Level, TemplatePart::Column, TemplatePart::Row].iter().all(|number| parts.contains(number));
        has_all.then_some(Self { parts })
    }

    /// The tile with a name; `None` if this is no tile's name.
    pub(super) fn tile(&self, name: &str) -> Option<NamedTile> {
        let mut tile = NamedTile { level: 0, column: 0, row: 0 };
        let mut rest = name;
        for part in &self.parts {
            let number = match part {
                TemplatePart::Text(text) => {
                    rest = rest.strip_prefix(text.as_str())?;
                    continue;
                }
                TemplatePart::Level => &mut tile.level,
                TemplatePart::Column => &mut tile.column,
                TemplatePart::Row => &mut tile.row,
            };
            let end = rest.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(rest.len());
            let (digits, after) = rest.split_at_checked(end)?;
            *number = digits.parse().ok()?;
            rest = after;
        }
        // Names with leading zeros, or with two values of a number, would not be found again.
        (rest.is_empty() && self.name(tile) == name).then_some(tile)
    }

    pub(super) fn name(&self, tile: NamedTile) -> String {
        let part = |part: &TemplatePart| match part {
            TemplatePart::Text(text) => text.clone(),
            TemplatePart::Level => tile.level.to_string(),
            TemplatePart::Column => tile.column.to_string(),
            TemplatePart::Row => tile.row.to_string(),
        };
        self.parts.iter().map(part).collect()
    }
}

/// The path of a template within the folder: without a query, and without the address of a server. The folders of an
/// address are not known here, so that those before the first with a number are left out.
fn path_of(text: &str) -> &str {
    let path = text.split(['?', '#']).next().unwrap_or(text);
    let is_address = path.contains("://") || path.starts_with('/');
    if !is_address {
        return path.trim_start_matches("./");
    }
    let first_number = ["{z}", "{x}", "{y}"].iter().filter_map(|number| path.find(number)).min().unwrap_or(0);
    let folder_end = path[..first_number].rfind('/').map_or(0, |slash| slash + 1);
    &path[folder_end..]
}
