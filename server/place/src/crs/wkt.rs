//! Well-known text as a tree, of any dialect.

/// Longer texts are refused: a system of coordinates needs a few kilobytes.
const MAX_BYTES: usize = 1 << 18;
/// Deeper nesting is refused: standards need about ten levels.
const MAX_DEPTH: usize = 24;

/// A keyword with its items, such as `UNIT["metre",1]`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Node {
    /// In upper case.
    pub(super) keyword: String,
    pub(super) items: Vec<Item>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Item {
    Text(String),
    Number(f64),
    Word(String),
    Node(Node),
}

impl Node {
    /// Parses one node, or several with commas between, as Esri writes a vertical system behind a horizontal one.
    /// `None` if the text is not well-formed.
    pub(super) fn parse_all(text: &str) -> Option<Vec<Self>> {
        if text.len() > MAX_BYTES {
            return None;
        }
        let mut parser = Parser { rest: text.trim_start() };
        let mut nodes = Vec::new();
        loop {
            match parser.item(0)? {
                Item::Node(node) => nodes.push(node),
                _ => return None,
            }
            if parser.rest.is_empty() {
                return Some(nodes);
            }
            parser.take(',')?;
        }
    }

    /// The nodes directly within this one.
    pub(super) fn nodes(&self) -> impl Iterator<Item = &Self> {
        self.items.iter().filter_map(|item| match item {
            Item::Node(node) => Some(node),
            _ => None,
        })
    }

    /// The first node directly within with one of these keywords.
    pub(super) fn node(&self, keywords: &[&str]) -> Option<&Self> {
        self.nodes().find(|node| keywords.contains(&&*node.keyword))
    }

    /// The first text: the name.
    pub(super) fn name(&self) -> &str {
        let text = self.items.iter().find_map(|item| match item {
            Item::Text(text) => Some(text.as_str()),
            _ => None,
        });
        text.unwrap_or_default()
    }

    /// The number at an index among the items.
    pub(super) fn number(&self, index: usize) -> Option<f64> {
        match self.items.get(index)? {
            Item::Number(number) => Some(*number),
            Item::Text(text) => text.trim().parse().ok().filter(|number: &f64| number.is_finite()),
            _ => None,
        }
    }

    /// Code of the EPSG registry, of `AUTHORITY` or `ID`.
    pub(super) fn epsg(&self) -> Option<u32> {
        let ids = self.nodes().filter(|node| matches!(&*node.keyword, "AUTHORITY" | "ID"));
        let code = ids.filter(|node| node.name().eq_ignore_ascii_case("EPSG")).find_map(|node| node.number(1))?;
        (code.fract() == 0.0 && (1.0..1e6).contains(&code)).then_some(code as u32)
    }
}

struct Parser<'t> {
    rest: &'t str,
}

impl Parser<'_> {
    fn skip_space(&mut self) {
        self.rest = self.rest.trim_start();
    }

    fn take(&mut self, wanted: char) -> Option<()> {
        self.rest = self.rest.strip_prefix(wanted)?;
        self.skip_space();
        Some(())
    }

    fn item(&mut self, depth: usize) -> Option<Item> {
        match self.rest.chars().next()? {
            '"' => self.text().map(Item::Text),
            '0'..='9' | '-' | '+' | '.' => self.number(),
            c if c.is_alphabetic() || c == '_' => self.word_or_node(depth),
            _ => None,
        }
    }

    /// A text in quotes; two quotes stand for one.
    fn text(&mut self) -> Option<String> {
        let mut text = String::new();
        loop {
            self.rest = self.rest.strip_prefix('"')?;
            let end = self.rest.find('"')?;
            text.push_str(&self.rest[..end]);
            self.rest = &self.rest[end + 1..];
            if !self.rest.starts_with('"') {
                self.skip_space();
                return Some(text);
            }
            text.push('"');
        }
    }

    /// A number, or a date such as `2016-01-01`, which is a word.
    fn number(&mut self) -> Option<Item> {
        let is_part = |c: char| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.' | ':');
        let end = self.rest.find(|c| !is_part(c)).unwrap_or(self.rest.len());
        let (text, rest) = self.rest.split_at(end);
        self.rest = rest;
        self.skip_space();
        let number = text.parse().ok().filter(|number: &f64| number.is_finite());
        Some(number.map_or_else(|| Item::Word(text.to_owned()), Item::Number))
    }

    fn word_or_node(&mut self, depth: usize) -> Option<Item> {
        let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | ':');
        let end = self.rest.find(|c| !is_part(c)).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest;
        self.skip_space();
        let close = match self.rest.chars().next() {
            Some('[') => ']',
            Some('(') => ')',
            _ => return Some(Item::Word(word.to_owned())),
        };
        if depth >= MAX_DEPTH {
            return None;
        }
        self.rest = &self.rest[1..];
        self.skip_space();
        let mut node = Node { keyword: word.to_ascii_uppercase(), items: Vec::new() };
        if self.rest.starts_with(close) {
            self.take(close)?;
            return Some(Item::Node(node));
        }
        loop {
            node.items.push(self.item(depth + 1)?);
            if self.rest.starts_with(close) {
                self.take(close)?;
                return Some(Item::Node(node));
            }
            self.take(',')?;
        }
    }
}
