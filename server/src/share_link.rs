//! Links that open a private city for a time.
//!
//! A link carries `?share=s1.KEY.CITY.VERSION.EXPIRY.SCOPE.MAC`. The MAC is HMAC-SHA-256 over all that precedes it, with the key
//! named KEY. VERSION is a version, or a prefix of versions and `~`. EXPIRY is in seconds since 1970. SCOPE is `a` (all addresses
//! of the city) or `r` (page, manifest, tiles and search only), followed by `~x0~y0~x1~y1` in millimetres if the link is for an area. All
//! characters are unreserved in URLs, so the link has one spelling.

use crate::secret_file::SecretFile;
use hmac::{Hmac, KeyInit, Mac};
use insula_protocol::name::is_name;
use insula_protocol::route::RouteTemplate;
use insula_protocol::{Manifest, TileId, TileKind};
use percent_encoding::percent_decode_str;
use sha2::Sha256;
use std::fmt::{self, Write};
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Name of the query parameter.
pub const PARAMETER: &str = "share";
const FORMAT: &str = "s1";
/// A link is valid for this long after its expiry, for clocks that differ.
const CLOCK_SKEW_SECS: u64 = 60;
const MAX_LINK_BYTES: usize = 512;
/// Bytes of a percent-encoded byte.
const ENCODED_BYTES: usize = 3;
const MIN_SECRET_BYTES: usize = 32;
const MAX_ID_BYTES: usize = 32;
const MM_PER_M: f64 = 1000.0;

type Signature = Hmac<Sha256>;

/// The keys of a key file, the newest last. The newest signs; all of them verify.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct ShareKeys(Vec<ShareKey>);

#[derive(Clone, PartialEq, Eq)]
struct ShareKey {
    id: String,
    secret: String,
}

/// What a link opens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShareGrant {
    pub city: String,
    /// A version; a prefix of versions that ends with `~`; `~` for all versions.
    pub version: String,
    /// Seconds since 1970.
    pub expires_secs: u64,
    pub scope: ShareScope,
}

/// The addresses that a link opens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShareScope {
    /// Page, manifest, tiles and search only.
    pub is_read_only: bool,
    /// `[x0, y0, x1, y1]` in millimetres of the city's reference system. Tiles outside of it are not opened.
    pub area_mm: Option<[i64; 4]>,
}

impl fmt::Debug for ShareKeys {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0.iter().map(|key| &key.id)).finish()
    }
}

impl ShareKeys {
    /// Reads a file with `ID SECRET` per line. Also returns what is wrong with it.
    pub(crate) fn read(path: &Path) -> (Self, Vec<String>) {
        let SecretFile { entries, mut faults } = SecretFile::read(path, parse_key);
        let mut keys: Vec<ShareKey> = Vec::new();
        for key in entries {
            if keys.iter().any(|known| known.id == key.id) {
                faults.push(format!("{}: two keys are named {}: the first one is used", path.display(), key.id));
            } else {
                keys.push(key);
            }
        }
        (Self(keys), faults)
    }

    /// Whether there is no key.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The value of the query parameter, signed with the newest key. `None` without a key.
    pub fn sign(&self, grant: &ShareGrant) -> Option<String> {
        let key = self.0.last()?;
        let ShareGrant { city, version, expires_secs, scope } = grant;
        let mut link = format!("{FORMAT}.{}.{city}.{version}.{expires_secs}.{scope}", key.id);
        let mac = key.signature(&link).finalize().into_bytes();
        link.push('.');
        for byte in mac {
            // Writing to a `String` cannot fail.
            let _ = write!(link, "{byte:02x}");
        }
        Some(link)
    }

    /// What the link opens; its characters may be percent-encoded, as programs on the way may do. `None` if it is malformed, has
    /// expired, or was not signed with one of the keys.
    pub fn verify(&self, link: &str, now: SystemTime) -> Option<ShareGrant> {
        if link.len() > ENCODED_BYTES * MAX_LINK_BYTES {
            return None;
        }
        let link = percent_decode_str(link).decode_utf8().ok().filter(|link| link.len() <= MAX_LINK_BYTES)?;
        let (signed, mac) = link.rsplit_once('.')?;
        let fields: Vec<&str> = signed.split('.').collect();
        let [FORMAT, id, city, version, expires_secs, scope] = fields[..] else { return None };
        let key = self.0.iter().find(|key| key.id == id)?;
        // The comparison takes constant time.
        key.signature(signed).verify_slice(&parse_hex(mac)?).ok()?;
        let expires_secs: u64 = expires_secs.parse().ok()?;
        let now_secs = now.duration_since(UNIX_EPOCH).ok()?.as_secs();
        if now_secs > expires_secs.saturating_add(CLOCK_SKEW_SECS) {
            return None;
        }
        let scope = ShareScope::parse(scope)?;
        Some(ShareGrant { city: city.to_owned(), version: version.to_owned(), expires_secs, scope })
    }
}

impl ShareKey {
    fn signature(&self, text: &str) -> Signature {
        let mut signature = match Signature::new_from_slice(self.secret.as_bytes()) {
            Ok(signature) => signature,
            Err(_) => unreachable!("HMAC takes keys of any length"),
        };
        signature.update(text.as_bytes());
        signature
    }
}

impl ShareGrant {
    /// Whether the link opens this version of its city.
    pub fn admits_version(&self, version: &str) -> bool {
        match self.version.strip_suffix('~') {
            Some(prefix) => version.starts_with(prefix),
            None => self.version == version,
        }
    }
}

impl ShareScope {
    fn parse(text: &str) -> Option<Self> {
        let mut parts = text.split('~');
        let is_read_only = match parts.next()? {
            "r" => true,
            "a" => false,
            _ => return None,
        };
        let area_mm: Vec<i64> = parts.map(str::parse).collect::<Result<_, _>>().ok()?;
        let area_mm = if area_mm.is_empty() { None } else { Some(area_mm.try_into().ok()?) };
        Some(Self { is_read_only, area_mm })
    }

    /// Whether the link opens addresses of this kind.
    pub fn admits_route(&self, route: RouteTemplate) -> bool {
        use RouteTemplate::{
            BlockMaps, Cities, CityPage, Filter, Groups, Index, Manifest, Meshes, Objects, Search, Subtrees, Thumbnail,
            Tileset, TilesetFile, Visibility,
        };
        let is_tile =
            matches!(route, Subtrees | BlockMaps | Meshes | Objects | Visibility | Groups | Tileset | TilesetFile);
        let is_read = is_tile || matches!(route, Search | Filter | Index | Cities | CityPage | Thumbnail | Manifest);
        !self.is_read_only || is_read
    }

    /// Whether what is computed of the whole city may be sent. It is limited to no area, and a read-only link opens searches only.
    pub fn admits_computed(&self, route: RouteTemplate) -> bool {
        self.area_mm.is_none() && (!self.is_read_only || route == RouteTemplate::Search)
    }

    /// Whether a tile may be sent. A block of objects has some of other places too, so only links without an area have objects.
    pub fn admits_tile(&self, city: &Manifest, kind: TileKind, node: TileId) -> bool {
        if kind == TileKind::Objects { self.area_mm.is_none() } else { self.admits_node(city, node) }
    }

    /// Whether a node meets the area.
    pub fn admits_node(&self, city: &Manifest, node: TileId) -> bool {
        let Some([x0, y0, x1, y1]) = self.area_mm.map(|area| area.map(|mm| mm as f64 / MM_PER_M)) else { return true };
        let side_m = city.root_side_m / f64::from(node.level()).exp2();
        let west = city.origin[0] + side_m * f64::from(node.x());
        let south = city.origin[1] + side_m * f64::from(node.y());
        west <= x1 && west + side_m >= x0 && south <= y1 && south + side_m >= y0
    }
}

impl fmt::Display for ShareScope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.is_read_only { "r" } else { "a" })?;
        self.area_mm.iter().flatten().try_for_each(|mm| write!(f, "~{mm}"))
    }
}

/// The link in a query, if there is one.
pub fn from_query(query: &str) -> Option<&str> {
    query.split('&').find_map(|pair| pair.strip_prefix(PARAMETER)?.strip_prefix('='))
}

/// Parses a time such as `30m`, `12h`, `7d` or `4w`. Fails unless it is above zero and at most ten years.
pub fn parse_lifetime(text: &str) -> Result<Duration, String> {
    let expected = || "expected a time of at most 3650d, such as 30m, 12h, 7d or 4w".to_owned();
    let (number, unit) = text.split_at_checked(text.len().wrapping_sub(1)).ok_or_else(expected)?;
    let unit_secs = match unit {
        "s" => 1,
        "m" => 60,
        "h" => 3600,
        "d" => 86_400,
        "w" => 7 * 86_400,
        _ => return Err(expected()),
    };
    let secs = number.parse::<u64>().ok().and_then(|number| number.checked_mul(unit_secs));
    let secs = secs.filter(|secs| (1..=3650 * 86_400).contains(secs));
    secs.map(Duration::from_secs).ok_or_else(expected)
}

/// The smallest area in whole millimetres around one between two corners in metres.
#[must_use]
pub fn area_mm([[west, south], [east, north]]: [[f64; 2]; 2]) -> [i64; 4] {
    let (down, up) = (|m: f64| (m * MM_PER_M).floor() as i64, |m: f64| (m * MM_PER_M).ceil() as i64);
    [down(west), down(south), up(east), up(north)]
}

/// Parses a version, or a prefix of versions followed by `*`, to a link's pattern. Fails if it cannot be a version.
pub fn parse_version(text: &str) -> Result<String, String> {
    match text.strip_suffix('*') {
        Some(prefix) if prefix.is_empty() || is_name(prefix) => Ok(format!("{prefix}~")),
        None if is_name(text) => Ok(text.to_owned()),
        _ => Err("expected a version, or a prefix of versions and *".into()),
    }
}

fn parse_key(line: &str) -> Result<ShareKey, &'static str> {
    const EXPECTED: &str = "a key must be a name of at most 32 of a-z, 0-9, _ and -, a space, and a secret of at least 32 visible characters";
    let (id, secret) = line.split_once([' ', '\t']).ok_or(EXPECTED)?;
    let secret = secret.trim();
    let is_valid = is_name(id)
        && id.len() <= MAX_ID_BYTES
        && secret.len() >= MIN_SECRET_BYTES
        && secret.bytes().all(|byte| byte.is_ascii_graphic());
    if is_valid { Ok(ShareKey { id: id.to_owned(), secret: secret.to_owned() }) } else { Err(EXPECTED) }
}

fn parse_hex(text: &str) -> Option<[u8; 32]> {
    let digit = |byte: u8| match byte {
        b'0'..=b'9' => Some(byte - b'0'),
        b'a'..=b'f' => Some(byte - b'a' + 10),
        _ => None,
    };
    let mut bytes = [0; 32];
    let (pairs, []) = text.as_bytes().as_chunks::<2>() else { return None };
    if pairs.len() != bytes.len() {
        return None;
    }
    for (byte, [high, low]) in bytes.iter_mut().zip(pairs) {
        *byte = digit(*high)? << 4 | digit(*low)?;
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(lines: &str) -> ShareKeys {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), lines).unwrap();
        ShareKeys::read(file.path()).0
    }

    fn grant() -> ShareGrant {
        let scope = ShareScope { is_read_only: true, area_mm: Some([-1000, 0, 2500, 1]) };
        ShareGrant { city: "delft".into(), version: "ab~".into(), expires_secs: 1_000_000, scope }
    }

    const OLD: &str = "old 0123456789abcdef0123456789abcdef";
    const NEW: &str = "new fedcba9876543210fedcba9876543210";

    #[test]
    fn a_link_is_valid_until_its_expiry_and_the_skew() {
        let keys = keys(NEW);
        let link = keys.sign(&grant()).unwrap();
        assert!(link.starts_with("s1.new.delft.ab~.1000000.r~-1000~0~2500~1."), "{link}");
        assert!(link.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._~".contains(&b)), "{link}");
        let at = |secs| keys.verify(&link, UNIX_EPOCH + Duration::from_secs(secs));
        assert_eq!(at(0), Some(grant()));
        assert!(at(1_000_060).is_some() && at(1_000_061).is_none());
        assert_eq!(from_query(&format!("a=b&share={link}&c")), Some(link.as_str()));
        assert_eq!(from_query("shared=x"), None);
    }

    #[test]
    fn a_link_may_be_percent_encoded() {
        let keys = keys(NEW);
        let link = keys.sign(&grant()).unwrap();
        let every: String = link.bytes().map(|byte| format!("%{byte:02x}")).collect();
        for encoded in [link.replace('~', "%7E"), link.replace('.', "%2e"), every] {
            assert_eq!(keys.verify(&encoded, UNIX_EPOCH), Some(grant()), "{encoded}");
        }
        for invalid in [link.replacen('.', "%", 1), link.replacen('.', "%252e", 1), link.replace('~', "%ff")] {
            assert_eq!(keys.verify(&invalid, UNIX_EPOCH), None, "{invalid}");
        }
    }

    #[test]
    fn every_altered_byte_makes_a_link_invalid() {
        let keys = keys(NEW);
        let link = keys.sign(&grant()).unwrap();
        for at in 0..link.len() {
            for other in [b'0', b'1', b'a', b'.', b'~'] {
                let mut bytes = link.clone().into_bytes();
                if bytes[at] != other {
                    bytes[at] = other;
                    assert_eq!(keys.verify(std::str::from_utf8(&bytes).unwrap(), UNIX_EPOCH), None, "byte {at}");
                }
            }
            assert_eq!(keys.verify(&link[..at], UNIX_EPOCH), None);
        }
        assert_eq!(keys.verify(&"s1.".repeat(1000), UNIX_EPOCH), None);
    }

    #[test]
    fn the_newest_key_signs_and_all_verify() {
        let old_link = keys(OLD).sign(&grant()).unwrap();
        let both = keys(&format!("{OLD}\n{NEW}\n"));
        assert!(both.sign(&grant()).unwrap().starts_with("s1.new."));
        assert!(both.verify(&old_link, UNIX_EPOCH).is_some());
        assert!(keys(NEW).verify(&old_link, UNIX_EPOCH).is_none(), "a removed key opens nothing");
        let other = keys("old ffffffffffffffffffffffffffffffff");
        assert!(other.verify(&old_link, UNIX_EPOCH).is_none(), "another secret of the same name");
        assert!(keys("short 0123").is_empty() && keys("").sign(&grant()).is_none());
        assert!(!format!("{both:?}").contains("0123"), "secrets are not printed");
    }

    #[test]
    fn scope_limits_versions_routes_and_area() {
        let grant = grant();
        assert!(grant.admits_version("abc") && !grant.admits_version("ac"));
        use RouteTemplate as R;
        let all = [R::Search, R::Filter, R::Draw, R::Analyse, R::Proposals, R::Tileset];
        for (is_read_only, area_mm, computed) in
            [(false, None, &all[..]), (true, None, &all[..1]), (false, Some([0; 4]), &[]), (true, Some([0; 4]), &[])]
        {
            let scope = ShareScope { is_read_only, area_mm };
            for route in all {
                assert_eq!(scope.admits_computed(route), computed.contains(&route), "{scope:?} {route:?}");
            }
        }
        assert!(grant.scope.admits_route(R::Meshes) && !grant.scope.admits_route(R::Other));
        assert_eq!(area_mm([[-1.0, 0.0], [2.5, 0.0005]]), [-1000, 0, 2500, 1]);
        assert_eq!(parse_version("*").as_deref(), Ok("~"));
        assert_eq!(parse_version("ab*").as_deref(), Ok("ab~"));
        assert!(parse_version("a~").is_err() && parse_version("A").is_err() && parse_version("").is_err());
        assert_eq!(parse_lifetime("7d"), Ok(Duration::from_secs(604_800)));
        assert!(
            ["", "d", "0d", "7", "7x", "99999d", "-1d", "7\u{e9}"].iter().all(|text| parse_lifetime(text).is_err())
        );
    }
}
