//! Texts of memo columns, which lie in a file beside the table: `.dbt` of dBASE III and IV, `.fpt` of FoxPro.

use crate::vector::local;
use insula_source::input::Input;
use insula_source::random_file::RandomFile;
use std::io::Read;

/// Bytes of the header that are read.
const HEADER_BYTES: usize = 24;
/// Of a block of dBASE III, and where nothing else is told.
const BLOCK_BYTES: u64 = 512;
/// First byte of a table of dBASE III with memos.
const DBASE_3: u8 = 0x83;
/// Begins a memo of dBASE IV.
const DBASE_4_MARK: [u8; 4] = [0xff, 0xff, 8, 0];
/// Of a memo of dBASE IV or FoxPro.
const MEMO_HEADER_BYTES: u32 = 8;
/// A memo of FoxPro that is a text, and no picture.
const TEXT: u32 = 1;
/// Ends a memo of dBASE III.
const END: u8 = 0x1a;
/// An end of a line that dBASE put where a text had none.
const SOFT_END: [u8; 2] = [0x8d, b'\n'];
/// Longer texts are cut, as those of all attributes are.
const MAX_TEXT_BYTES: u64 = 1 << 14;

/// The file beside a table.
pub(super) struct MemoFile {
    file: RandomFile,
    is_fox_pro: bool,
    block_bytes: u64,
}

impl MemoFile {
    /// Opens the file beside a table whose first byte is `version`. Fails with the reason.
    pub(super) fn open(table: &Input<'_>, version: u8) -> Result<Self, String> {
        let find = |extension| local::sibling(table, extension);
        let (name, is_fox_pro) = match (find("fpt"), find("dbt")) {
            (Some(name), _) => (name, true),
            (None, Some(name)) => (name, false),
            (None, None) => return Err("no .dbt or .fpt file beside it".to_owned()),
        };
        let file = Input { name: &name, ..*table }.random().map_err(|error| error.to_string())?;
        let head = read(&file, 0, HEADER_BYTES as u64).unwrap_or_default();
        let told = match head.get(..HEADER_BYTES) {
            Some(head) if is_fox_pro => u16::from_be_bytes([head[6], head[7]]),
            Some(head) if version != DBASE_3 => u16::from_le_bytes([head[20], head[21]]),
            Some(_) => 0,
            None => return Err(format!("{name} ends within its header")),
        };
        let block_bytes = if told == 0 { BLOCK_BYTES } else { u64::from(told) };
        Ok(Self { file, is_fox_pro, block_bytes })
    }

    /// The text that a field names, empty without one; `None` if it cannot be read.
    pub(super) fn text(&self, field: &[u8]) -> Option<Vec<u8>> {
        let block = match field.first_chunk() {
            Some(number) if field.len() == 4 => u64::from(u32::from_le_bytes(*number)),
            _ => match std::str::from_utf8(field).ok()?.trim_matches(['\0', ' ']) {
                "" => 0,
                number => number.parse().ok()?,
            },
        };
        if block == 0 {
            return Some(Vec::new());
        }
        let start = block.checked_mul(self.block_bytes)?;
        let head = read(&self.file, start, MEMO_HEADER_BYTES.into())?;
        let word = |at: usize| head.get(at..)?.first_chunk::<4>().copied();
        let length = if self.is_fox_pro {
            if u32::from_be_bytes(word(0)?) != TEXT {
                return Some(Vec::new());
            }
            u32::from_be_bytes(word(4)?)
        } else if word(0) == Some(DBASE_4_MARK) {
            u32::from_le_bytes(word(4)?).checked_sub(MEMO_HEADER_BYTES)?
        } else {
            return self.marked_text(start);
        };
        let start = start.checked_add(MEMO_HEADER_BYTES.into())?;
        let text = read(&self.file, start, u64::from(length).min(MAX_TEXT_BYTES))?;
        (text.len() as u64 == u64::from(length).min(MAX_TEXT_BYTES)).then_some(text)
    }

    /// A text of dBASE III, which goes on to a mark.
    fn marked_text(&self, start: u64) -> Option<Vec<u8>> {
        let mut text = read(&self.file, start, MAX_TEXT_BYTES).filter(|text| !text.is_empty())?;
        text.truncate(text.iter().position(|byte| *byte == END).unwrap_or(text.len()));
        let mut at = 0;
        while let Some(place) = text.get(at..)?.windows(2).position(|pair| pair == SOFT_END) {
            at += place;
            drop(text.splice(at..at + 2, [b' ']));
        }
        Some(text)
    }
}

/// At most `length` bytes from a position on; `None` if they cannot be read.
fn read(file: &RandomFile, position: u64, length: u64) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    file.reader(position).take(length).read_to_end(&mut bytes).ok()?;
    Some(bytes)
}
