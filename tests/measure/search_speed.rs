//! Measures the search index with made-up names: bytes per name, and the time of queries on one core.
//!
//! `cargo run --release -p insula-measure --bin search_speed [NAMES [KIND]]`, by default 1.7 million names. Kinds:
//! `streets` (default) are a third each of Dutch and German addresses and of Japanese blocks; `towns` have a post code and a
//! town behind each Dutch and German address; `identifiers` have one word each.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use insula_objects::search::{SearchHit, SearchIndex, SearchIndexBuilder};

const QUERIES: usize = 10_000;
const LIMIT: usize = 10;

/// SplitMix64: the same names each time.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) % end as u64) as usize
    }

    fn of<'a>(&mut self, list: &[&'a str]) -> &'a str {
        list[self.below(list.len())]
    }
}

const DUTCH: [&[&str]; 3] = [
    &["Oude ", "Nieuwe ", "Korte ", "Lange ", "Van ", "De ", "", "", "", "", "", "", "Sint ", "Jan van "],
    &[
        "Delf",
        "Kerk",
        "Molen",
        "Boer",
        "Haven",
        "Vis",
        "Linden",
        "Eiken",
        "Beuken",
        "Wilhelmina",
        "Juliana",
        "Prinsen",
        "Konings",
        "Heren",
        "Keizers",
        "Rozen",
        "Tulpen",
        "Dijk",
        "IJssel",
        "Maas",
        "Schie",
        "Rotte",
        "Amstel",
        "Zaan",
        "Spui",
        "Markt",
        "Raad",
        "Gasthuis",
        "Klooster",
        "Toren",
        "Brug",
        "Sluis",
        "Polder",
        "Weide",
        "Heide",
        "Bosch",
        "Berg",
        "Duin",
        "Zee",
        "Vijver",
        "Burgemeester",
        "Professor",
        "Huygens",
        "Rembrandt",
        "Vermeer",
        "Hals",
        "Steen",
    ],
    &[
        "straat",
        "laan",
        "weg",
        "plein",
        "gracht",
        "kade",
        "singel",
        "dreef",
        "hof",
        "pad",
        "steeg",
        "plantsoen",
        "park",
        "dijk",
        "burgwal",
        "akker",
        "veld",
        "zijde",
        "horst",
        "oord",
    ],
];

const GERMAN: [&[&str]; 3] = [
    &["", "", "", "", "Am ", "An der ", "Alte ", "Neue ", "Große ", "Kleine ", "Obere ", "Untere "],
    &[
        "Müller",
        "Schäfer",
        "König",
        "Goethe",
        "Schiller",
        "Mozart",
        "Linden",
        "Eichen",
        "Büchner",
        "Jäger",
        "Mühlen",
        "Kirch",
        "Schloss",
        "Bahnhof",
        "Garten",
        "Wiesen",
        "Wald",
        "Berg",
        "Tal",
        "Brücken",
        "Fürsten",
        "Kaiser",
        "Rhein",
        "Donau",
        "Elb",
        "Isar",
        "Neckar",
        "Zöllner",
        "Gärtner",
        "Weber",
        "Schmiede",
        "Töpfer",
        "Böttcher",
        "Färber",
        "Bismarck",
        "Humboldt",
        "Leibniz",
        "Röntgen",
        "Händel",
        "Dürer",
        "Grün",
        "Sonnen",
        "Blumen",
        "Rosen",
        "Tannen",
    ],
    &[
        "straße",
        "allee",
        "weg",
        "platz",
        "gasse",
        "ufer",
        "ring",
        "damm",
        "steig",
        "höhe",
        "grund",
        "park",
        "hof",
        "bogen",
        "zeile",
        "chaussee",
        "promenade",
        "winkel",
    ],
];

const WARDS: &[&str] = &[
    "東京都千代田区",
    "東京都中央区",
    "東京都港区",
    "東京都新宿区",
    "東京都文京区",
    "東京都台東区",
    "東京都墨田区",
    "東京都江東区",
    "東京都品川区",
    "東京都目黒区",
    "東京都大田区",
    "東京都世田谷区",
    "東京都渋谷区",
    "東京都中野区",
    "東京都杉並区",
    "大阪府大阪市北区",
    "大阪府大阪市中央区",
    "京都府京都市左京区",
    "京都府京都市右京区",
    "神奈川県横浜市西区",
    "神奈川県横浜市中区",
    "北海道札幌市中央区",
];

const PLACES: [&[&str]; 2] = [
    &[
        "丸の", "大手", "霞が", "永田", "神田", "銀", "日本", "八", "築", "月", "赤", "青", "麻", "芝", "白", "高",
        "西", "東", "南", "北", "本", "上", "下", "中", "新",
    ],
    &[
        "内", "町", "関", "座", "橋", "地", "島", "坂", "山", "布", "浦", "金", "輪", "新宿", "池", "川", "谷", "原",
        "田", "沢", "木", "野", "井", "里", "宮",
    ],
];

fn street(parts: &[&[&str]; 3], random: &mut Random) -> String {
    let (front, name, end) = (random.of(parts[0]), random.of(parts[1]), random.of(parts[2]));
    // Two names in half of the streets, so that there are tens of thousands.
    let second = if random.below(2) == 0 { random.of(parts[1]).to_lowercase() } else { String::new() };
    format!("{front}{name}{second}{end}")
}

fn address(parts: &[&[&str]; 3], town: bool, random: &mut Random, names: &mut BTreeSet<String>, most: usize) {
    const TOWNS: [&str; 8] = ["Delft", "Rotterdam", "Den Haag", "Leiden", "Berlin", "Köln", "München", "Zürich"];
    let street = street(parts, random);
    let behind = if town { format!(", {} {}", 1000 + random.below(9000), random.of(&TOWNS)) } else { String::new() };
    for number in 1..=5 + random.below(150) {
        let letter = if random.below(12) == 0 { random.of(&["A", "B", "C", "-1", "-2"]) } else { "" };
        if names.len() < most {
            names.insert(format!("{street} {number}{letter}{behind}"));
        }
    }
}

fn make_names(count: usize, kind: &str) -> Vec<String> {
    let mut random = Random(7);
    let mut names = BTreeSet::new();
    if kind == "identifiers" {
        return (0..count).map(|i| format!("NL.IMBAG.Pand.0503{:012}", i * 7 + random.below(7))).collect();
    }
    let towns = kind == "towns";
    while names.len() < count / 3 {
        address(&DUTCH, towns, &mut random, &mut names, count / 3);
    }
    while names.len() < count / 3 * 2 {
        address(&GERMAN, towns, &mut random, &mut names, count / 3 * 2);
    }
    while names.len() < count {
        let place = format!("{}{}{}", random.of(WARDS), random.of(PLACES[0]), random.of(PLACES[1]));
        for part in 1..=1 + random.below(6) {
            for block in 1..=1 + random.below(40) {
                names.insert(format!("{place}{part}丁目"));
                names.insert(format!("{place}{part}丁目{block}番"));
                if random.below(3) == 0 {
                    names.extend((1..=random.below(20)).map(|house| format!("{place}{part}丁目{block}番{house}号")));
                }
            }
        }
    }
    names.into_iter().take(count).collect()
}

/// What a person types on the way to a name: the start of it, or of some of its words.
fn prefix_query(name: &str, random: &mut Random) -> String {
    let words: Vec<&str> = name.split(' ').collect();
    let from = words[random.below(words.len())..].join(" ");
    let chars: Vec<char> = from.chars().collect();
    // Texts without spaces may be found from each of their characters on, but not from within a number.
    let starts: Vec<usize> = (0..chars.len()).filter(|at| *at == 0 || chars[*at] > '\u{3000}').collect();
    let skipped = starts[random.below(starts.len())];
    let end = skipped + 1 + random.below(chars.len() - skipped);
    chars[skipped..end].iter().collect()
}

/// A name in which one word of five letters or more has a typo.
fn typo_query(name: &str, random: &mut Random) -> String {
    let mut words: Vec<String> = name.split(' ').map(str::to_owned).collect();
    let long: Vec<usize> = (0..words.len()).filter(|at| words[*at].chars().count() >= 5).collect();
    if let Some(at) = long.get(random.below(long.len().max(1))) {
        let mut chars: Vec<char> = words[*at].chars().collect();
        let place = random.below(chars.len() - 1);
        match random.below(4) {
            0 => chars[place] = 'x',
            1 => chars.insert(place, 'e'),
            2 => drop(chars.remove(place)),
            _ => chars.swap(place, place + 1),
        }
        words[*at] = chars.into_iter().collect();
    }
    words.truncate(1 + random.below(words.len()));
    words.join(" ")
}

fn report(what: &str, index: &SearchIndex<Vec<u8>>, queries: &[String], is_good: impl Fn(&str, &[SearchHit]) -> bool) {
    let (mut times, mut good) = (Vec::new(), 0);
    for query in queries {
        // The least of three times: other processes share the processor.
        let time = || {
            let start = Instant::now();
            (std::hint::black_box(index.search(query, LIMIT)).len(), start.elapsed()).1
        };
        times.push((time().min(time()).min(time()), query));
        let hits = index.search(query, LIMIT);
        good += usize::from(is_good(query, &hits));
    }
    times.sort();
    let at = |part: f64| times[((times.len() - 1) as f64 * part) as usize].0;
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    let worst = &times[times.len() - 1];
    println!(
        "{what}: {} queries, p50 {:.3} ms, p99 {:.3} ms, worst {:.3} ms ({}), with a hit {:.1} %",
        queries.len(),
        ms(at(0.5)),
        ms(at(0.99)),
        ms(worst.0),
        worst.1,
        100.0 * good as f64 / queries.len() as f64
    );
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let count = arguments.first().map_or(Ok(1_700_000), |count| count.parse())?;
    let names = make_names(count, arguments.get(1).map_or("streets", String::as_str));
    let mut random = Random(1);
    // Objects in random order are the worst case of their numbers.
    let mut objects: Vec<u32> = (0..names.len() as u32).collect();
    for at in (1..objects.len()).rev() {
        objects.swap(at, random.below(at + 1));
    }
    let start = Instant::now();
    let mut builder = SearchIndexBuilder::new();
    names.iter().zip(&objects).for_each(|(name, object)| builder.add(name, *object));
    let bytes = builder.finish()?;
    println!(
        "{} names, {:.1} bytes each; index of {} bytes, {:.2} per name, built in {:.1} s",
        names.len(),
        names.iter().map(String::len).sum::<usize>() as f64 / names.len() as f64,
        bytes.len(),
        bytes.len() as f64 / names.len() as f64,
        start.elapsed().as_secs_f64()
    );
    let start = Instant::now();
    let index = SearchIndex::open(bytes)?;
    println!("opened in {:.1} ms: {index:?}", start.elapsed().as_secs_f64() * 1e3);

    let mut sample = |query: fn(&str, &mut Random) -> String| -> Vec<String> {
        (0..QUERIES).map(|_| query(&names[random.below(names.len())], &mut random)).collect()
    };
    let (whole, prefixes, typos) = (sample(|name, _| name.to_owned()), sample(prefix_query), sample(typo_query));
    report("whole names", &index, &whole, |query, hits| hits.first().is_some_and(|hit| hit.text == query));
    report("prefixes", &index, &prefixes, |_, hits| !hits.is_empty());
    report("typos", &index, &typos, |_, hits| !hits.is_empty());
    let short: Vec<String> = [
        "a",
        "s",
        "1",
        "12",
        "va",
        "van 1",
        "kerk 1",
        "straat",
        "丁",
        "1丁目",
        "東京都",
        "番 1",
        "de",
        "str 12",
        "keer 1",
    ]
    .map(str::to_owned)
    .into();
    let odd: Vec<String> = [
        "kerk berg hals vest dijk laan stee zeed rott maas spui mark raad kloo tore brug slui pold weid heid bosc duin vijv burg prof",
        "kerx berx halx vesx dijx laax steex zeedx rottx maasx spux markx raadx kloox torex brugx sluix poldx weidx heidx",
        "oeoeoeoe aeaeaeae ueueueue boeboeboe koekoekoe",
        "東京都千代田区丸の内東京都千代田区丸の内東京都千代田区丸の内東京都千代田区丸の内東京都千代田区丸の内東京都千代田区丸の内",
        "1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32 33 34 35 36 37",
    ]
    .map(str::to_owned)
    .into();
    report("odd", &index, &odd, |_, hits| !hits.is_empty());
    report("short", &index, &short, |_, hits| !hits.is_empty());
    Ok(())
}
