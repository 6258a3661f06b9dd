//! The encoding of texts: named by a `.cpg` file, by a number in the table's header, or not at all.

use encoding_rs::Encoding;
use insula_source::text::is_hardly_western;

/// How bytes are letters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Charset {
    Known(&'static Encoding),
    /// A code page of DOS, of which `encoding_rs` has only that of Russia: ASCII, and these letters for 128 to 255.
    Dos(&'static str),
}

const CP437: &str = "ÇüéâäàåçêëèïîìÄÅÉæÆôöòûùÿÖÜ¢£¥₧ƒáíóúñÑªº¿⌐¬½¼¡«»░▒▓│┤╡╢╖╕╣║╗╝╜╛┐└┴┬├─┼╞╟╚╔╩╦╠═╬╧╨╤╥╙╘╒╓╫╪┘┌█▄▌▐▀\
                     αßΓπΣσµτΦΘΩδ∞φε∩≡±≥≤⌠⌡÷≈°∙·√ⁿ²■\u{a0}";
const CP850: &str = "ÇüéâäàåçêëèïîìÄÅÉæÆôöòûùÿÖÜø£Ø×ƒáíóúñÑªº¿®¬½¼¡«»░▒▓│┤ÁÂÀ©╣║╗╝¢¥┐└┴┬├─┼ãÃ╚╔╩╦╠═╬¤ðÐÊËÈıÍÎÏ┘┌█▄¦Ì▀\
                     ÓßÔÒõÕµþÞÚÛÙýÝ¯´\u{ad}±‗¾¶§÷¸°¨·¹³²■\u{a0}";
const CP852: &str = "ÇüéâäůćçłëŐőîŹÄĆÉĹĺôöĽľŚśÖÜŤťŁ×čáíóúĄąŽžĘę¬źČş«»░▒▓│┤ÁÂĚŞ╣║╗╝Żż┐└┴┬├─┼Ăă╚╔╩╦╠═╬¤đĐĎËďŇÍÎě┘┌█▄ŢŮ▀\
                     ÓßÔŃńňŠšŔÚŕŰýÝţ´\u{ad}˝˛ˇ˘§÷¸°¨˙űŘř■\u{a0}";
/// Code pages of DOS by their numbers.
const DOS: [(&str, &str); 3] = [("437", CP437), ("850", CP850), ("852", CP852)];

/// Encodings by the header's number.
const LANGUAGES: &[(&[u8], &str)] = &[
    (&[0x01, 0x0b, 0x0d, 0x0f, 0x11, 0x15, 0x18, 0x19, 0x1b], "437"),
    (&[0x02, 0x0a, 0x0e, 0x10, 0x12, 0x14, 0x16, 0x1a, 0x1d, 0x25, 0x37], "850"),
    (&[0x1f, 0x22, 0x23, 0x40, 0x64, 0x87], "852"),
    (&[0x03, 0x57, 0x58, 0x59], "windows-1252"),
    (&[0x04], "macintosh"),
    (&[0x13, 0x7b], "shift_jis"),
    (&[0x4d, 0x7a], "gbk"),
    (&[0x4e, 0x79], "euc-kr"),
    (&[0x4f, 0x78], "big5"),
    (&[0x50, 0x7c], "windows-874"),
    (&[0x26, 0x65, 0x66], "ibm866"),
    (&[0xc8], "windows-1250"),
    (&[0xc9], "windows-1251"),
    (&[0xca], "windows-1254"),
    (&[0xcb], "windows-1253"),
    (&[0xcc], "windows-1257"),
];

/// Encodings by the number of a code page.
const CODE_PAGES: &[(&str, &str)] = &[
    ("65001", "utf-8"),
    ("932", "shift_jis"),
    ("936", "gbk"),
    ("54936", "gb18030"),
    ("949", "euc-kr"),
    ("950", "big5"),
    ("866", "ibm866"),
    ("874", "windows-874"),
    ("20932", "euc-jp"),
    ("51932", "euc-jp"),
];

/// The encoding of a table by the text of its `.cpg` file, else by the number in its header; `None` if neither tells.
pub(super) fn encoding_of(code_page: Option<&str>, language: u8) -> Option<Charset> {
    let by_language = || LANGUAGES.iter().find(|(numbers, _)| numbers.contains(&language)).map(|(_, label)| *label);
    code_page.and_then(by_name).or_else(|| by_language().and_then(by_label))
}

/// The encoding with a name of `encoding_rs`, or with the number of a code page of DOS.
fn by_label(label: &str) -> Option<Charset> {
    let dos = DOS.iter().find(|(number, _)| *number == label).map(|(_, letters)| Charset::Dos(letters));
    dos.or_else(|| Encoding::for_label(label.as_bytes()).map(Charset::Known))
}

/// The encoding of a name such as `UTF-8`, `1252`, `ANSI 1252`, `ISO 8859-1`, `88591`, `OEM 850` or `LDID/87`.
fn by_name(name: &str) -> Option<Charset> {
    let name = name.trim();
    if let Some(encoding) = Encoding::for_label(name.as_bytes()) {
        return Some(Charset::Known(encoding));
    }
    let digits: String = name.chars().filter(char::is_ascii_digit).collect();
    if name.to_ascii_uppercase().starts_with("LDID") {
        return encoding_of(None, digits.parse().ok()?);
    }
    if let Some((_, label)) = CODE_PAGES.iter().find(|(number, _)| *number == digits) {
        return by_label(label);
    }
    match digits.strip_prefix("8859") {
        Some(part) => by_label(&format!("iso-8859-{part}")),
        None if digits.len() == 4 && digits.starts_with("125") => by_label(&format!("windows-{digits}")),
        None if digits == "8" && name.to_ascii_uppercase().contains("UTF") => by_label("utf-8"),
        None => DOS.iter().find(|(number, _)| *number == digits).map(|(_, letters)| Charset::Dos(letters)),
    }
}

/// The text of a field. Of no known encoding it is UTF-8, or else Windows-1252.
pub(super) fn decode(field: &[u8], charset: Option<Charset>) -> String {
    let encoding = match charset {
        Some(Charset::Known(encoding)) => Some(encoding),
        Some(Charset::Dos(letters)) => return decode_dos(field, letters),
        None => None,
    };
    let is_utf8 = encoding.is_none_or(|encoding| encoding == encoding_rs::UTF_8);
    match std::str::from_utf8(field) {
        Ok(text) if is_utf8 => text.to_owned(),
        // Cut within a character, because the column is too narrow.
        Err(fault) if is_utf8 && fault.error_len().is_none() => {
            String::from_utf8_lossy(&field[..fault.valid_up_to()]).into_owned()
        }
        _ => encoding.unwrap_or(encoding_rs::WINDOWS_1252).decode_without_bom_handling(field).0.into_owned(),
    }
}

/// Whether a text that is read as Windows-1252, by default, is probably in another encoding.
pub(super) fn is_odd(field: &[u8], charset: Option<Charset>) -> bool {
    let is_guess = charset.is_none_or(|charset| charset == Charset::Known(encoding_rs::WINDOWS_1252));
    is_guess && is_hardly_western(field)
}

fn decode_dos(field: &[u8], letters: &str) -> String {
    let letter = |byte: &u8| match byte.checked_sub(128) {
        None => char::from(*byte),
        Some(index) => letters.chars().nth(usize::from(index)).unwrap_or(char::REPLACEMENT_CHARACTER),
    };
    field.iter().map(letter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_encodings() {
        let name = |text| match by_name(text)? {
            Charset::Known(encoding) => Some(encoding.name()),
            Charset::Dos(letters) => DOS.iter().find(|(_, known)| *known == letters).map(|(number, _)| *number),
        };
        assert_eq!(name("UTF-8"), Some("UTF-8"));
        assert_eq!(name(" utf 8"), Some("UTF-8"));
        assert_eq!(name("ANSI 1252"), Some("windows-1252"));
        assert_eq!(name("88591"), Some("windows-1252"));
        assert_eq!(name("ISO 8859-2"), Some("ISO-8859-2"));
        assert_eq!(name("LDID/19"), Some("Shift_JIS"));
        assert_eq!(name("CP932"), Some("Shift_JIS"));
        assert_eq!(name("OEM 936"), Some("GBK"));
        assert_eq!((name("OEM 850"), name("cp437"), name("852")), (Some("850"), Some("437"), Some("852")));
        assert_eq!((name("LDID/1"), name("LDID/100")), (Some("437"), Some("852")));
        assert_eq!(name("klingon"), None);
        assert_eq!(encoding_of(Some("klingon"), 0x13), Some(Charset::Known(encoding_rs::SHIFT_JIS)));
        assert_eq!(encoding_of(None, 0), None);
    }

    #[test]
    fn texts_of_any_encoding() {
        assert_eq!(decode(b"Stra\xdfe", None), "Straße");
        assert_eq!(decode("Straße".as_bytes(), None), "Straße");
        assert_eq!(decode(&"Straße".as_bytes()[..5], Some(Charset::Known(encoding_rs::UTF_8))), "Stra");
        assert_eq!(decode(b"\x93\x8c\x8b\x9e", Some(Charset::Known(encoding_rs::SHIFT_JIS))), "東京");
        // As dBASE wrote them on DOS.
        assert_eq!(decode(b"Stra\xe1e \x81", encoding_of(None, 0x01)), "Straße ü");
        assert_eq!(decode(b"S\xc6o", encoding_of(None, 0x02)), "São");
        assert_eq!(decode(b"\x9d\xa2d\xab", encoding_of(None, 0x64)), "Łódź");
        assert!(DOS.iter().all(|(_, letters)| letters.chars().count() == 128));
        let (gbk, _, _) = encoding_rs::GBK.encode("人民公园");
        assert!(is_odd(&gbk, None) && is_odd(&gbk, encoding_of(None, 0x57)) && !is_odd(&gbk, encoding_of(None, 0x4d)));
        assert!(!is_odd(b"Stra\xdfe", None) && !is_odd("人民公园".as_bytes(), None));
    }
}
