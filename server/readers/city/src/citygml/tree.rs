//! The elements of one object in compact form: flat arrays, with the coordinates as numbers and each surface as one
//! element.

use super::names::{Class, NameId, Names};
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::Range;

/// A larger object is left out.
pub(super) const MAX_OBJECT_BYTES: usize = 256 << 20;
/// An object whose elements are nested deeper is left out.
pub(super) const MAX_OBJECT_DEPTH: usize = 200;
/// Larger arrays are given back after use.
pub(super) const KEPT_BYTES: usize = 16 << 20;

/// Attributes of elements that are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AttributeKind {
    Id,
    Href,
    SrsName,
    SrsDimension,
    CodeSpace,
    Uom,
    Name,
    Orientation,
    Ring,
    Uri,
    Decimal,
    CoordinateMark,
    TupleMark,
}

impl AttributeKind {
    pub(super) fn of(local_name: &str) -> Option<Self> {
        Some(match local_name {
            "id" | "fid" => Self::Id,
            "href" => Self::Href,
            "srsName" => Self::SrsName,
            "srsDimension" => Self::SrsDimension,
            "codeSpace" => Self::CodeSpace,
            "uom" => Self::Uom,
            "name" => Self::Name,
            "orientation" => Self::Orientation,
            "ring" => Self::Ring,
            "uri" => Self::Uri,
            "decimal" => Self::Decimal,
            "cs" => Self::CoordinateMark,
            "ts" => Self::TupleMark,
            _ => return None,
        })
    }
}

/// What an element has besides elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Content {
    None,
    /// Bytes of [`Tree::text`].
    Text {
        start: u32,
        end: u32,
    },
    /// Indices of [`Tree::points`].
    Points {
        start: u32,
        end: u32,
    },
    /// Index of [`Tree::faces`].
    Face(u32),
    /// Indices of [`Tree::points`], three for each triangle.
    Triangles {
        start: u32,
        end: u32,
    },
}

/// An element. Its children follow it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    pub(super) name: NameId,
    /// Index after its last descendant.
    pub(super) end: u32,
    pub(super) attributes: (u32, u32),
    pub(super) content: Content,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct TreeAttribute {
    pub(super) kind: AttributeKind,
    pub(super) start: u32,
    pub(super) end: u32,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Ring {
    /// Hash of its identifier; 0 without.
    pub(super) id: u64,
    /// Indices of [`Tree::points`].
    pub(super) start: u32,
    pub(super) end: u32,
    pub(super) is_hole: bool,
    /// A part of it is a curve that is not read, or a reference to one. It has no points then.
    pub(super) is_unread: bool,
}

/// A planar surface. Its rings are those from `first_ring` on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    pub(super) first_ring: u32,
    pub(super) rings: u32,
}

/// The elements of one object.
#[derive(Debug, Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) attributes: Vec<TreeAttribute>,
    pub(super) text: String,
    pub(super) points: Vec<[f64; 3]>,
    pub(super) rings: Vec<Ring>,
    pub(super) faces: Vec<Face>,
    /// Elements by the hashes of their identifiers. Of equal ones the first.
    pub(super) ids: HashMap<u64, u32>,
}

/// Hash of an identifier, or of a reference to it such as `#id`. Never 0.
pub(super) fn hash_of_reference(reference: &str) -> u64 {
    let id = reference.rsplit_once('#').map_or(reference, |(_, id)| id);
    let mut hasher = DefaultHasher::new();
    id.trim().hash(&mut hasher);
    hasher.finish().max(1)
}

impl Tree {
    /// Removes everything.
    pub(super) fn clear(&mut self) {
        fn clear<T>(list: &mut Vec<T>) {
            list.clear();
            list.shrink_to(KEPT_BYTES / size_of::<T>());
        }
        clear(&mut self.nodes);
        clear(&mut self.attributes);
        clear(&mut self.points);
        clear(&mut self.rings);
        clear(&mut self.faces);
        self.text.clear();
        self.text.shrink_to(KEPT_BYTES);
        self.ids.clear();
        self.ids.shrink_to(KEPT_BYTES / 32);
    }

    /// Memory in use.
    pub(super) fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>()
            + self.attributes.len() * size_of::<TreeAttribute>()
            + self.text.len()
            + self.points.len() * size_of::<[f64; 3]>()
            + self.rings.len() * size_of::<Ring>()
            + self.faces.len() * size_of::<Face>()
            + self.ids.len() * 2 * size_of::<(u64, u32)>()
    }

    pub(super) fn children(&self, node: u32) -> impl Iterator<Item = u32> {
        let end = self.nodes[node as usize].end;
        let mut next = node + 1;
        std::iter::from_fn(move || {
            let child = Some(next).filter(|child| *child < end)?;
            next = self.nodes[child as usize].end;
            Some(child)
        })
    }

    pub(super) fn node(&self, node: u32) -> &Node {
        &self.nodes[node as usize]
    }

    /// Whether an element has no elements.
    pub(super) fn is_leaf(&self, node: u32) -> bool {
        self.node(node).end == node + 1
    }

    pub(super) fn class(&self, names: &Names, node: u32) -> Class {
        names.class(self.node(node).name)
    }

    pub(super) fn child_of_class(&self, names: &Names, node: u32, class: Class) -> Option<u32> {
        self.children(node).find(|child| self.class(names, *child) == class)
    }

    /// The first child of a local name.
    pub(super) fn child_named(&self, names: &Names, node: u32, local: &str) -> Option<u32> {
        self.children(node).find(|child| names.local(self.node(*child).name) == local)
    }

    /// The element itself and all of its descendants.
    pub(super) fn subtree(&self, node: u32) -> Range<u32> {
        node..self.node(node).end
    }

    /// The trimmed text of an element; `None` if it has none.
    pub(super) fn text_of(&self, node: u32) -> Option<&str> {
        match self.node(node).content {
            Content::Text { start, end } => self.text.get(start as usize..end as usize),
            _ => None,
        }
    }

    /// An attribute's value, trimmed.
    pub(super) fn attribute(&self, node: u32, kind: AttributeKind) -> Option<&str> {
        self.raw_attribute(node, kind).map(str::trim)
    }

    fn raw_attribute(&self, node: u32, kind: AttributeKind) -> Option<&str> {
        let (start, end) = self.node(node).attributes;
        let attributes = self.attributes.get(start as usize..end as usize)?;
        let TreeAttribute { start, end, .. } = attributes.iter().find(|attribute| attribute.kind == kind)?;
        self.text.get(*start as usize..*end as usize)
    }

    /// An attribute that is one character, which may be white space.
    pub(super) fn mark(&self, node: u32, kind: AttributeKind) -> Option<char> {
        self.raw_attribute(node, kind)?.chars().next().map(|c| if c.is_ascii_whitespace() { ' ' } else { c })
    }

    /// Hash of an element's identifier.
    pub(super) fn id_hash(&self, node: u32) -> Option<u64> {
        self.attribute(node, AttributeKind::Id).map(hash_of_reference)
    }

    pub(super) fn rings_of(&self, face: u32) -> &[Ring] {
        let Some(Face { first_ring, rings }) = self.faces.get(face as usize) else { return &[] };
        self.rings.get(*first_ring as usize..(*first_ring + *rings) as usize).unwrap_or(&[])
    }

    pub(super) fn points_of(&self, ring: &Ring) -> &[[f64; 3]] {
        self.points.get(ring.start as usize..ring.end as usize).unwrap_or(&[])
    }
}
