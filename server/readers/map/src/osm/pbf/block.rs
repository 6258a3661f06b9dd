//! Elements of a block of a PBF file (`PrimitiveBlock`).

use super::wire::{Packed, WireFault, fields, zigzag};
use crate::osm::element::{Element, ElementId, Member, Tags, Visit, id_of_position, position};
use insula_source::error::InputError;
use insula_source::object::ObjectSink;
use insula_source::problems::ENCODING_GUESSED;
use insula_source::text::{not_in_utf8, page_of_others};
use std::borrow::Cow;
use std::ops::{ControlFlow, Range};

/// Ways with more nodes are left out. The database of OpenStreetMap allows 2,000.
const MAX_REFS: usize = 1 << 20;
/// Relations with more members are left out. The database of OpenStreetMap allows 32,000.
const MAX_MEMBERS: usize = 1 << 20;

/// Which elements of a block are decoded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Wanted {
    pub(super) nodes: bool,
    pub(super) node_tags: bool,
    /// Numbers of ways.
    pub(super) ways: Range<u64>,
    /// Positions that ways have in place of nodes, as nodes.
    pub(super) way_nodes: bool,
    pub(super) relations: bool,
}

/// Which elements a block has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct BlockContent {
    /// First and last identifier of nodes.
    pub(super) nodes: Option<(i64, i64)>,
    /// Number of the first way, and the number after the last.
    pub(super) ways: [u64; 2],
    /// Ways have the positions of their nodes, which are no elements then (the feature `LocationsOnWays`).
    pub(super) has_way_nodes: bool,
}

/// Why the decoding of a block ended early.
#[derive(Debug)]
pub(super) enum BlockFault {
    Wire,
    Visit(InputError),
}

impl From<WireFault> for BlockFault {
    fn from(WireFault: WireFault) -> Self {
        Self::Wire
    }
}

type Visited = Result<(), BlockFault>;

/// Decodes blocks; keeps its memory from one to the next.
#[derive(Default)]
pub(super) struct BlockDecoder {
    spans: Vec<[u32; 4]>,
    refs: Vec<i64>,
}

/// A block whose elements are visited.
struct OpenBlock<'b> {
    /// Behind those of the file are the letters of texts that are not in UTF-8.
    bytes: Cow<'b, [u8]>,
    /// Start and end of each text of the block.
    texts: Vec<[u32; 2]>,
    granularity: i64,
    lat_offset: i64,
    lon_offset: i64,
}

/// Where the elements of a block go.
pub(super) struct Visitor<'a, 'v> {
    pub(super) sink: &'a mut dyn ObjectSink,
    pub(super) visit: &'a mut Visit<'v>,
    pub(super) wanted: &'a Wanted,
    pub(super) content: BlockContent,
    pub(super) is_ended: bool,
}

impl Visitor<'_, '_> {
    fn element(&mut self, element: Element<'_>) -> Visited {
        let flow = (self.visit)(element, self.sink).map_err(BlockFault::Visit)?;
        self.is_ended |= flow == ControlFlow::Break(());
        Ok(())
    }

    fn problem(&mut self, kind: &'static str, detail: impl FnOnce() -> String) {
        // In the first pass.
        if self.wanted.relations {
            self.sink.problem(kind, detail());
        }
    }
}

impl BlockDecoder {
    /// Visits the wanted elements of a block until the visitor ends. `bytes` are at most 4 GiB.
    pub(super) fn decode(&mut self, bytes: &[u8], visitor: &mut Visitor<'_, '_>) -> Visited {
        let mut groups = Vec::new();
        let mut block =
            OpenBlock { bytes: bytes.into(), texts: Vec::new(), granularity: 100, lat_offset: 0, lon_offset: 0 };
        fields(bytes, |number, value| {
            match number {
                1 => block.read_texts(value.bytes()?)?,
                2 => groups.push(value.bytes()?),
                17 => block.granularity = i64::from(value.number()? as i32),
                19 => block.lat_offset = value.number()? as i64,
                20 => block.lon_offset = value.number()? as i64,
                _ => {}
            }
            Ok(())
        })?;
        block.decode_others(|report| visitor.problem(ENCODING_GUESSED, || report));
        for group in groups {
            self.decode_group(&block, group, visitor)?;
        }
        Ok(())
    }

    fn decode_group(&mut self, block: &OpenBlock<'_>, mut group: &[u8], visitor: &mut Visitor<'_, '_>) -> Visited {
        while !group.is_empty() && !visitor.is_ended {
            // One field at a time: visiting can end between them.
            let (number, message, rest) = super::wire::first_field(group)?;
            group = rest;
            match number {
                1 if visitor.wanted.nodes => self.decode_node(block, message.bytes()?, visitor)?,
                2 if visitor.wanted.nodes => self.decode_dense(block, message.bytes()?, visitor)?,
                3 => {
                    let way = visitor.content.ways[1];
                    visitor.content.ways[1] += 1;
                    if visitor.wanted.way_nodes || visitor.wanted.ways.contains(&way) {
                        self.decode_way(block, message.bytes()?, way, visitor)?;
                    }
                }
                4 if visitor.wanted.relations => self.decode_relation(block, message.bytes()?, visitor)?,
                _ => {}
            }
        }
        Ok(())
    }

    fn decode_node(&mut self, block: &OpenBlock<'_>, message: &[u8], visitor: &mut Visitor<'_, '_>) -> Visited {
        let (mut id, mut lat, mut lon) = (0, 0, 0);
        let (mut keys, mut values) = (Packed::default(), Packed::default());
        fields(message, |number, value| {
            match number {
                1 => id = zigzag(value.number()?),
                2 => keys = Packed(value.bytes()?),
                3 => values = Packed(value.bytes()?),
                8 => lat = zigzag(value.number()?),
                9 => lon = zigzag(value.number()?),
                _ => {}
            }
            Ok(())
        })?;
        self.spans.clear();
        let is_whole = !visitor.wanted.node_tags || block.read_tags(keys, values, &mut self.spans)?;
        if !is_whole {
            visitor.problem("tag with a text that the block lacks", || format!("node/{id}"));
        }
        self.visit_node(block, id, [lon, lat], visitor)
    }

    /// Visits a node with the tags that were read last.
    fn visit_node(
        &mut self,
        block: &OpenBlock<'_>,
        id: i64,
        [lon, lat]: [i64; 2],
        visitor: &mut Visitor<'_, '_>,
    ) -> Visited {
        let (first, last) = visitor.content.nodes.unwrap_or((id, id));
        visitor.content.nodes = Some((first.min(id), last.max(id)));
        match block.position(lon, lat) {
            Some(position) => visitor.element(Element::Node { id, position, tags: block.tags(&self.spans) }),
            None => {
                visitor.problem("node outside of the world", || format!("node/{id}"));
                Ok(())
            }
        }
    }

    fn decode_dense(&mut self, block: &OpenBlock<'_>, message: &[u8], visitor: &mut Visitor<'_, '_>) -> Visited {
        let [mut ids, mut lats, mut lons, mut tags] = [Packed::default(); 4];
        fields(message, |number, value| {
            match number {
                1 => ids = Packed(value.bytes()?),
                8 => lats = Packed(value.bytes()?),
                9 => lons = Packed(value.bytes()?),
                10 if visitor.wanted.node_tags => tags = Packed(value.bytes()?),
                _ => {}
            }
            Ok(())
        })?;
        let (mut id, mut lat, mut lon) = (0_i64, 0_i64, 0_i64);
        for step in ids {
            if visitor.is_ended {
                break;
            }
            // Wrapping: a sum beyond the range is no valid position and no node of a way.
            id = id.wrapping_add(zigzag(step?));
            lat = lat.wrapping_add(zigzag(lats.next().ok_or(WireFault)??));
            lon = lon.wrapping_add(zigzag(lons.next().ok_or(WireFault)??));
            self.spans.clear();
            if !block.read_dense_tags(&mut tags, &mut self.spans)? {
                visitor.problem("tag with a text that the block lacks", || format!("node/{id}"));
            }
            self.visit_node(block, id, [lon, lat], visitor)?;
        }
        Ok(())
    }

    fn decode_way(
        &mut self,
        block: &OpenBlock<'_>,
        message: &[u8],
        way: u64,
        visitor: &mut Visitor<'_, '_>,
    ) -> Visited {
        let (id, [keys, values, refs, lats, lons]) = lists_of(message)?;
        self.refs.clear();
        let mut node = 0_i64;
        for step in refs {
            if self.refs.len() == MAX_REFS {
                visitor.problem("way with too many nodes, left out", || format!("way/{id}"));
                return Ok(());
            }
            node = node.wrapping_add(zigzag(step?));
            self.refs.push(node);
        }
        if !lats.0.is_empty() {
            visitor.content.has_way_nodes = true;
            self.place_nodes(block, [lons, lats], visitor)?;
        }
        if visitor.wanted.way_nodes {
            return Ok(());
        }
        self.spans.clear();
        if !block.read_tags(keys, values, &mut self.spans)? {
            visitor.problem("tag with a text that the block lacks", || format!("way/{id}"));
        }
        visitor.element(Element::Way { id, number: way, refs: &self.refs, tags: block.tags(&self.spans) })
    }

    /// Replaces the nodes of a way by those at their positions, and visits these if they are wanted.
    fn place_nodes(
        &mut self,
        block: &OpenBlock<'_>,
        [lons, mut lats]: [Packed<'_>; 2],
        visitor: &mut Visitor<'_, '_>,
    ) -> Visited {
        let (mut lat, mut lon) = (0_i64, 0_i64);
        for (node, step) in self.refs.iter_mut().zip(lons) {
            lon = lon.wrapping_add(zigzag(step?));
            lat = lat.wrapping_add(zigzag(lats.next().ok_or(WireFault)??));
            let Some(position) = block.position(lon, lat) else {
                visitor.problem("node outside of the world", || format!("node/{node}"));
                continue;
            };
            *node = id_of_position(position);
            if visitor.wanted.way_nodes {
                visitor.element(Element::Node { id: *node, position, tags: Tags::default() })?;
            }
        }
        Ok(())
    }

    fn decode_relation(&mut self, block: &OpenBlock<'_>, message: &[u8], visitor: &mut Visitor<'_, '_>) -> Visited {
        let (id, [keys, values, mut roles, ids, mut types]) = lists_of(message)?;
        self.spans.clear();
        if !block.read_tags(keys, values, &mut self.spans)? {
            visitor.problem("tag with a text that the block lacks", || format!("relation/{id}"));
        }
        let mut members = Vec::new();
        let mut member = 0_i64;
        for step in ids {
            if members.len() == MAX_MEMBERS {
                visitor.problem("relation with too many members, left out", || format!("relation/{id}"));
                return Ok(());
            }
            member = member.wrapping_add(zigzag(step?));
            let role = block.text(roles.next().ok_or(WireFault)??).unwrap_or_default();
            let element = match types.next().ok_or(WireFault)?? {
                1 => Some(ElementId::Way(member)),
                2 => Some(ElementId::Relation(member)),
                _ => None,
            };
            members.push(Member { element, role });
        }
        visitor.element(Element::Relation { id, members: &members, tags: block.tags(&self.spans) })
    }
}

/// The identifier of a way or a relation, its keys and values, and the three lists of its members.
fn lists_of(message: &[u8]) -> Result<(i64, [Packed<'_>; 5]), WireFault> {
    let (mut id, mut lists) = (0, [Packed::default(); 5]);
    fields(message, |number, value| {
        match number {
            1 => id = value.number()? as i64,
            2 | 3 => lists[number as usize - 2] = Packed(value.bytes()?),
            8..=10 => lists[number as usize - 6] = Packed(value.bytes()?),
            _ => {}
        }
        Ok(())
    })?;
    Ok((id, lists))
}

impl<'b> OpenBlock<'b> {
    /// Notes the places of the texts of a `StringTable`.
    fn read_texts(&mut self, table: &'b [u8]) -> Result<(), WireFault> {
        // Both are slices of `bytes`.
        let start_of = |part: &[u8]| part.as_ptr().addr().wrapping_sub(self.bytes.as_ptr().addr());
        fields(table, |number, value| {
            if number == 1 {
                let text = value.bytes()?;
                let start = start_of(text) as u32;
                self.texts.push([start, start + text.len() as u32]);
            }
            Ok(())
        })
    }

    /// Decodes the texts that are not in UTF-8, in the code page that is likely for all of them.
    fn decode_others(&mut self, mut report: impl FnMut(String)) {
        let text_of = |[start, end]: &[u32; 2]| self.bytes.get(*start as usize..*end as usize).unwrap_or_default();
        let Some(page) = page_of_others(self.texts.iter().map(text_of)) else { return };
        let mut letters = Vec::new();
        for place in &mut self.texts {
            let bytes = self.bytes.get(place[0] as usize..place[1] as usize).unwrap_or_default();
            if std::str::from_utf8(bytes).is_err() {
                let text = page.decode(bytes);
                report(not_in_utf8(&text, page));
                let start = self.bytes.len() + letters.len();
                letters.extend_from_slice(text.as_bytes());
                // A block has at most 32 MiB, of which a byte becomes three.
                *place = [start as u32, (start + text.len()) as u32];
            }
        }
        self.bytes.to_mut().extend(letters);
    }

    fn text(&self, index: u64) -> Option<&[u8]> {
        let [start, end] = *self.texts.get(usize::try_from(index).ok()?)?;
        self.bytes.get(start as usize..end as usize)
    }

    fn tags<'t>(&'t self, spans: &'t [[u32; 4]]) -> Tags<'t> {
        Tags { text: &self.bytes, spans }
    }

    /// Adds a tag. Returns whether the block has its texts.
    fn push_tag(&self, key: u64, value: u64, spans: &mut Vec<[u32; 4]>) -> bool {
        let place = |index: u64| self.texts.get(usize::try_from(index).ok()?);
        let (Some([a, b]), Some([c, d])) = (place(key), place(value)) else {
            return false;
        };
        spans.push([*a, *b, *c, *d]);
        true
    }

    /// Adds the tags of an element. Returns whether the block has all of their texts.
    fn read_tags(
        &self,
        keys: Packed<'_>,
        mut values: Packed<'_>,
        spans: &mut Vec<[u32; 4]>,
    ) -> Result<bool, WireFault> {
        let mut is_whole = true;
        for key in keys {
            is_whole &= self.push_tag(key?, values.next().ok_or(WireFault)??, spans);
        }
        Ok(is_whole)
    }

    /// Adds the tags of the next dense node. They end with a zero. Returns whether the block has all of their texts.
    fn read_dense_tags(&self, tags: &mut Packed<'_>, spans: &mut Vec<[u32; 4]>) -> Result<bool, WireFault> {
        let mut is_whole = true;
        while let Some(key) = tags.next() {
            let key = key?;
            if key == 0 {
                break;
            }
            is_whole &= self.push_tag(key, tags.next().ok_or(WireFault)??, spans);
        }
        Ok(is_whole)
    }

    /// Position of stored values; `None` outside of the world.
    fn position(&self, lon: i64, lat: i64) -> Option<[i32; 2]> {
        // Billionths of degrees, rounded to 1e-7 degrees.
        let units = |value: i64, offset: i64| {
            let nano = value.checked_mul(self.granularity)?.checked_add(offset)?;
            Some(nano.checked_add(50)?.div_euclid(100))
        };
        position(units(lon, self.lon_offset)?, units(lat, self.lat_offset)?)
    }
}
