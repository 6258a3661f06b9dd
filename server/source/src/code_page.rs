//! Code pages: how the bytes of a text are letters.

use encoding_rs::{Encoding, UTF_8, WINDOWS_1252};
use std::borrow::Cow;
use std::fmt;

/// How bytes are letters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CodePage {
    Known(&'static Encoding),
    /// One of DOS, of which `encoding_rs` has only that of Russia.
    Dos(&'static DosPage),
}

/// A code page of DOS: ASCII, and these letters for 128 to 255.
#[derive(Debug, PartialEq, Eq)]
pub struct DosPage {
    number: &'static str,
    letters: &'static str,
}

const CP437: DosPage = DosPage {
    number: "437",
    letters: "ÇüéâäàåçêëèïîìÄÅÉæÆôöòûùÿÖÜ¢£¥₧ƒáíóúñÑªº¿⌐¬½¼¡«»░▒▓│┤╡╢╖╕╣║╗╝╜╛┐└┴┬├─┼╞╟╚╔╩╦╠═╬╧╨╤╥╙╘╒╓╫╪┘┌█▄▌▐▀\
              αßΓπΣσµτΦΘΩδ∞φε∩≡±≥≤⌠⌡÷≈°∙·√ⁿ²■\u{a0}",
};
pub(crate) const CP850: DosPage = DosPage {
    number: "850",
    letters: "ÇüéâäàåçêëèïîìÄÅÉæÆôöòûùÿÖÜø£Ø×ƒáíóúñÑªº¿®¬½¼¡«»░▒▓│┤ÁÂÀ©╣║╗╝¢¥┐└┴┬├─┼ãÃ╚╔╩╦╠═╬¤ðÐÊËÈıÍÎÏ┘┌█▄¦Ì▀\
              ÓßÔÒõÕµþÞÚÛÙýÝ¯´\u{ad}±‗¾¶§÷¸°¨·¹³²■\u{a0}",
};
pub(crate) const CP852: DosPage = DosPage {
    number: "852",
    letters: "ÇüéâäůćçłëŐőîŹÄĆÉĹĺôöĽľŚśÖÜŤťŁ×čáíóúĄąŽžĘę¬źČş«»░▒▓│┤ÁÂĚŞ╣║╗╝Żż┐└┴┬├─┼Ăă╚╔╩╦╠═╬¤đĐĎËďŇÍÎě┘┌█▄ŢŮ▀\
              ÓßÔŃńňŠšŔÚŕŰýÝţ´\u{ad}˝˛ˇ˘§÷¸°¨˙űŘř■\u{a0}",
};
static DOS: [DosPage; 3] = [CP437, CP850, CP852];

impl CodePage {
    /// Texts of most sources.
    pub const UTF8: Self = Self::Known(UTF_8);
    /// Texts of western Europe by Windows.
    pub const WESTERN: Self = Self::Known(WINDOWS_1252);

    /// The page with a name of `encoding_rs`, or with the number of a code page of DOS.
    pub fn by_label(label: &str) -> Option<Self> {
        let dos = DOS.iter().find(|page| page.number == label).map(Self::Dos);
        dos.or_else(|| Encoding::for_label(label.as_bytes()).map(Self::Known))
    }

    /// A text. Bytes that are none of the page become U+FFFD.
    pub fn decode<'t>(&self, bytes: &'t [u8]) -> Cow<'t, str> {
        match self {
            Self::Known(encoding) => encoding.decode_without_bom_handling(bytes).0,
            Self::Dos(page) => bytes.iter().map(|byte| page.letter(*byte)).collect::<String>().into(),
        }
    }
}

impl fmt::Display for CodePage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Known(encoding) => f.write_str(encoding.name()),
            Self::Dos(page) => write!(f, "CP{}", page.number),
        }
    }
}

impl DosPage {
    fn letter(&self, byte: u8) -> char {
        match byte.checked_sub(128) {
            None => char::from(byte),
            Some(index) => self.letters.chars().nth(usize::from(index)).unwrap_or(char::REPLACEMENT_CHARACTER),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_dos_have_a_letter_for_each_byte() {
        assert!(DOS.iter().all(|page| page.letters.chars().count() == 128));
        let page = CodePage::by_label("850").unwrap();
        assert_eq!((&*page.decode(b"Stra\xe1e \x81"), page.to_string()), ("Straße ü", "CP850".to_owned()));
        assert_eq!(CodePage::by_label("437").unwrap().decode(b"\x9b\xe1"), "¢ß");
        assert_eq!(CodePage::by_label("852").unwrap().decode(b"\x9d\xa2d\xab"), "Łódź");
        assert_eq!(CodePage::by_label("windows-1251").unwrap().to_string(), "windows-1251");
        assert_eq!(CodePage::by_label("klingon"), None);
    }
}
