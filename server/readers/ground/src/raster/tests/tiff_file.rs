//! Makes TIFF files by hand.

#[derive(Clone)]
pub(super) enum Values {
    Shorts(Vec<u16>),
    Long(u32),
    Doubles(Vec<f64>),
    Text(&'static str),
}

/// One image: its tags, and its tiles or strips. Empty ones are left out of the file.
#[derive(Clone, Default)]
pub(super) struct TestImage {
    pub(super) tags: Vec<(u16, Values)>,
    pub(super) is_tiled: bool,
    pub(super) chunks: Vec<Vec<u8>>,
    /// All tiles or strips are the first one, which the file has once.
    pub(super) is_shared: bool,
}

/// How a file is written.
#[derive(Clone, Copy, Default)]
pub(super) struct TestForm {
    pub(super) is_big_endian: bool,
    pub(super) is_big_tiff: bool,
}

impl TestImage {
    /// An image of bands of a width and height, with bits of a sample format, in one strip.
    pub(super) fn new([width, height]: [u16; 2], bands: u16, [bits, format]: [u16; 2], pixels: Vec<u8>) -> Self {
        let image = Self { tags: Vec::new(), is_tiled: false, chunks: vec![pixels], is_shared: false };
        let image = image.shorts(256, &[width]).shorts(257, &[height]).shorts(277, &[bands]);
        image.shorts(258, &vec![bits; bands.into()]).shorts(339, &vec![format; bands.into()])
    }

    pub(super) fn tag(mut self, tag: u16, values: Values) -> Self {
        self.tags.retain(|(other, _)| *other != tag);
        self.tags.push((tag, values));
        self
    }

    pub(super) fn shorts(self, tag: u16, values: &[u16]) -> Self {
        self.tag(tag, Values::Shorts(values.to_vec()))
    }

    /// Has tiles of a size in place of the strip.
    pub(super) fn tiles(mut self, [width, height]: [u16; 2], tiles: Vec<Vec<u8>>) -> Self {
        (self.is_tiled, self.chunks) = (true, tiles);
        self.shorts(322, &[width]).shorts(323, &[height])
    }

    /// Has the first tile or strip once, in the place of all.
    pub(super) fn shared(self) -> Self {
        Self { is_shared: true, ..self }
    }

    /// The file with this image alone.
    pub(super) fn file(&self) -> Vec<u8> {
        file(TestForm::default(), std::slice::from_ref(self))
    }
}

/// The file with some images.
pub(super) fn file(form: TestForm, images: &[TestImage]) -> Vec<u8> {
    let mut bytes = if form.is_big_endian { b"MM".to_vec() } else { b"II".to_vec() };
    let offset_size = if form.is_big_tiff { 8 } else { 4 };
    form.push(&mut bytes, if form.is_big_tiff { 43 } else { 42 }, 2);
    if form.is_big_tiff {
        form.push(&mut bytes, 8, 2);
        form.push(&mut bytes, 0, 2);
    }
    let mut link = bytes.len();
    form.push(&mut bytes, 0, offset_size);
    for image in images {
        link = form.append(&mut bytes, image, link);
    }
    bytes
}

impl TestForm {
    fn number(self, number: u64, size: usize) -> Vec<u8> {
        if self.is_big_endian {
            number.to_be_bytes()[8 - size..].to_vec()
        } else {
            number.to_le_bytes()[..size].to_vec()
        }
    }

    fn push(self, bytes: &mut Vec<u8>, number: u64, size: usize) {
        bytes.extend(self.number(number, size));
    }

    /// Appends an image and sets the link to it. Returns the place of the next link.
    fn append(self, bytes: &mut Vec<u8>, image: &TestImage, link: usize) -> usize {
        let field_size = if self.is_big_tiff { 8 } else { 4 };
        let (mut offsets, mut counts) = (Vec::new(), Vec::new());
        let start = bytes.len();
        for chunk in &image.chunks {
            let is_written = image.is_shared && bytes.len() > start;
            let place = if is_written { start } else { bytes.len() };
            self.push(&mut offsets, if chunk.is_empty() { 0 } else { place as u64 }, 4);
            self.push(&mut counts, chunk.len() as u64, 4);
            if !is_written {
                bytes.extend(chunk);
            }
        }
        let (offsets_tag, counts_tag) = if image.is_tiled { (324, 325) } else { (273, 279) };
        let count = image.chunks.len();
        let mut entries = vec![(offsets_tag, 4, count, offsets), (counts_tag, 4, count, counts)];
        entries.extend(image.tags.iter().map(|(tag, values)| self.entry(*tag, values)));
        entries.sort_by_key(|entry| entry.0);
        let entries: Vec<_> = entries
            .into_iter()
            .map(|(tag, kind, count, mut value)| {
                if value.len() > field_size {
                    let offset = bytes.len() as u64;
                    bytes.extend(value);
                    value = self.number(offset, field_size);
                }
                value.resize(field_size, 0);
                (tag, kind, count, value)
            })
            .collect();
        let directory = self.number(bytes.len() as u64, field_size);
        bytes[link..link + field_size].copy_from_slice(&directory);
        self.push(bytes, entries.len() as u64, if self.is_big_tiff { 8 } else { 2 });
        for (tag, kind, count, value) in entries {
            self.push(bytes, tag.into(), 2);
            self.push(bytes, kind, 2);
            self.push(bytes, count as u64, field_size);
            bytes.extend(value);
        }
        self.push(bytes, 0, field_size);
        bytes.len() - field_size
    }

    fn entry(self, tag: u16, values: &Values) -> (u16, u64, usize, Vec<u8>) {
        let (kind, count, numbers, size): (u64, usize, Vec<u64>, usize) = match values {
            Values::Shorts(values) => (3, values.len(), values.iter().map(|value| (*value).into()).collect(), 2),
            Values::Long(value) => (4, 1, vec![(*value).into()], 4),
            Values::Doubles(values) => (12, values.len(), values.iter().map(|value| value.to_bits()).collect(), 8),
            Values::Text(text) => (2, text.len() + 1, text.bytes().chain([0]).map(u64::from).collect(), 1),
        };
        (tag, kind, count, numbers.into_iter().flat_map(|number| self.number(number, size)).collect())
    }
}
