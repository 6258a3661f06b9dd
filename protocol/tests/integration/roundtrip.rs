//! V-BlockMap tiles: round trips, truncation and damage.

use insula_protocol::blockmap::{
    COLUMNS, ColumnClip, CornerWall, MapColumn, OuterTop, Quality, ThinShare, WallStrip, strip_rows,
};
use insula_protocol::texel::OPAQUE;
use insula_protocol::tile::TileWriter;
use insula_protocol::{BlockMap, DecodeError, Texel, TileId, TileKind};
use insula_test_support::tier;
use proptest::prelude::*;

fn opaque(bits: u32) -> Texel {
    Texel(bits | OPAQUE)
}

/// The colour of open texels is not kept.
fn open_or_opaque(texel: Texel) -> Texel {
    if texel.is_open() { Texel::OPEN } else { opaque(texel.0) }
}

fn column() -> impl Strategy<Value = MapColumn> {
    let texel = any::<u32>().prop_map(opaque);
    (0u16..4000, 1u16..95, any::<[bool; 9]>(), texel, any::<u16>(), any::<u32>(), any::<u8>()).prop_map(
        |(
            z_min,
            height,
            [inclined, suspended, exposed, gap, clipped, outer, corner, concave, reflective],
            roof,
            roof_normal,
            seed,
            azimuth,
        )| {
            let z_max = z_min + height;
            let rows = strip_rows(z_min, z_max, 1).1;
            let texels = (0..u32::from(rows)).map(|i| open_or_opaque(Texel(seed.wrapping_mul(i * 2 + 1)))).collect();
            let gap = (gap && exposed && height > 3).then_some([z_min + 1, z_max - 1]);
            let strip = exposed.then_some(WallStrip { texels, azimuth });
            let outer = (outer && height > 1).then_some(OuterTop { z: z_max - 1, roof: opaque(seed) });
            let corner = corner.then_some(CornerWall { azimuth, offset: (seed >> 8) as i8, concave });
            let clip = (clipped && exposed).then_some(ColumnClip { offset: seed as i8, corner, outer });
            let may_be_thin = exposed && !clipped && !inclined && seed % 3 == 0;
            let thin = may_be_thin.then_some(ThinShare { side: (seed >> 24) as u8 | 1, top: (seed >> 16) as u8 });
            MapColumn { z_min, z_max, inclined, suspended, gap, roof, roof_normal, strip, clip, reflective, thin }
        },
    )
}

fn map() -> impl Strategy<Value = BlockMap> {
    let id = (0u8..=20).prop_flat_map(|l| (Just(l), 0..1u32 << l, 0..1u32 << l));
    let columns = proptest::collection::vec((any::<usize>(), column()), 0..200);
    (id, 0.01f32..100.0, any::<i32>(), columns).prop_map(|((level, x, y), cell_m, z_base, list)| {
        let mut columns = vec![None; COLUMNS];
        for (at, column) in list {
            columns[at % COLUMNS] = Some(column);
        }
        BlockMap::from_columns(TileId::new(level, x, y).unwrap(), cell_m, z_base, 1, &columns).unwrap()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(tier::cases()))]

    #[test]
    fn any_map_round_trips(map in map()) {
        let bytes = map.encode().unwrap();
        let back = BlockMap::decode(map.id, &bytes).unwrap();
        prop_assert!(back.flags == map.flags, "flags");
        prop_assert!((&back.z_min, &back.z_max, &back.gaps) == (&map.z_min, &map.z_max, &map.gaps), "heights");
        prop_assert!((&back.roof_normal, &back.wall_azimuth) == (&map.roof_normal, &map.wall_azimuth), "directions");
        prop_assert!((&back.clips, &back.thin) == (&map.clips, &map.thin), "clips and thin columns");
        prop_assert!(back.roof == map.roof, "roofs");
        prop_assert!(back.strips == map.strips, "strips");
        prop_assert!(back == map);
        let again = BlockMap::from_columns(map.id, map.cell_m, map.z_base_cells, map.z_shift, &back.columns()).unwrap();
        prop_assert_eq!(again, map);
    }

    #[test]
    fn loss_is_within_the_quality_and_shapes_are_exact(map in map(), db in 10f32..60.0) {
        let bytes = map.encode_at(Quality::Decibels(db)).unwrap();
        prop_assert_eq!(&map.encode_at(Quality::Decibels(db)).unwrap(), &bytes);
        let back = BlockMap::decode(map.id, &bytes).unwrap();
        let texels = |map: &BlockMap| -> Vec<Texel> {
            let outers = map.clips.iter().filter_map(|clip| Some(clip.outer?.roof));
            map.roof.iter().chain(&map.strips).copied().chain(outers).collect()
        };
        let (mut squares, mut count) = (0.0, 0.0);
        for (a, b) in texels(&map).into_iter().zip(texels(&back)).filter(|(a, _)| *a != Texel::OPEN) {
            prop_assert_eq!(a.is_open(), b.is_open());
            prop_assert!(a.ao().abs_diff(b.ao()) <= 2, "{} became {}", a.ao(), b.ao());
            if !a.is_open() {
                squares += a.rgb().into_iter().zip(b.rgb()).map(|(a, b)| f64::from(a.abs_diff(b)).powi(2)).sum::<f64>();
                count += 3.0;
            }
        }
        let worst = 255.0 * 255.0 / 10f64.powf(f64::from(db) / 10.0);
        prop_assert!(squares <= worst * count * 1.000_001, "{} over {worst}", squares / count);
        let mut shape = back;
        shape.roof.clone_from(&map.roof);
        shape.strips.clone_from(&map.strips);
        for (clip, original) in shape.clips.iter_mut().zip(&map.clips) {
            if let (Some(a), Some(b)) = (&mut clip.outer, original.outer) {
                a.roof = b.roof;
            }
        }
        prop_assert_eq!(shape, map);
    }

    #[test]
    fn random_column_bytes_decode_to_a_valid_map_or_an_error(
        bytes in proptest::collection::vec(any::<u8>(), 1..3000),
        ground in proptest::collection::vec(any::<u8>(), 0..300),
        reflective in proptest::collection::vec(any::<u8>(), 0..60),
        shift in 0u8..=4,
    ) {
        let mut writer = TileWriter::new(TileKind::BlockMap, None);
        let meta = [&1f32.to_le_bytes()[..], &0i32.to_le_bytes(), &[shift], &32u16.to_le_bytes(), &[4]].concat();
        writer.add_raw_section(1, &meta).unwrap();
        writer.add_raw_section(2, &bytes).unwrap();
        writer.add_raw_section(3, &ground).unwrap();
        writer.add_raw_section(4, &reflective).unwrap();
        if let Ok(map) = BlockMap::decode(TileId::ROOT, &writer.finish().unwrap()) {
            prop_assert_eq!(&BlockMap::decode(TileId::ROOT, &map.encode().unwrap()).unwrap(), &map);
            prop_assert!(map.stand_on_ground().encode().is_ok());
        }
    }

    #[test]
    fn any_flipped_bit_is_refused(map in map(), at in any::<usize>(), bit in 0u8..8) {
        let mut bytes = map.encode().unwrap();
        let at = at % bytes.len();
        bytes[at] ^= 1 << bit;
        prop_assert!(BlockMap::decode(TileId::ROOT, &bytes).is_err());
    }

    #[test]
    fn random_bytes_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(BlockMap::decode(TileId::ROOT, &bytes).is_err());
    }
}

#[test]
fn truncated_and_extra_bytes_are_refused() {
    let mut columns = vec![None; COLUMNS];
    columns[77] = Some(MapColumn { z_min: 3, z_max: 40, ..MapColumn::default() });
    let bytes = BlockMap::from_columns(TileId::ROOT, 1.0, -3, 0, &columns).unwrap().encode().unwrap();
    for len in 0..bytes.len() {
        assert!(BlockMap::decode(TileId::ROOT, &bytes[..len]).is_err(), "{len} of {}", bytes.len());
    }
    let longer = [&bytes[..], &[0]].concat();
    assert_eq!(BlockMap::decode(TileId::ROOT, &longer), Err(DecodeError::TrailingBytes(1)));
}

#[test]
fn invalid_columns_are_refused() {
    let build = |column: MapColumn| {
        let mut columns = vec![None; COLUMNS];
        columns[0] = Some(column);
        BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns)
    };
    let good = MapColumn { z_min: 0, z_max: 40, ..MapColumn::default() };
    assert!(build(good.clone()).is_ok());
    assert!(build(MapColumn { z_min: 40, ..good.clone() }).is_err(), "no height");
    assert!(build(MapColumn { z_max: 4096, ..good.clone() }).is_err(), "over 12 bits");
    assert!(build(MapColumn { gap: Some([10, 20]), ..good.clone() }).is_err(), "gap without strip");
    let clip = |z: u16| Some(ColumnClip { offset: 5, corner: None, outer: Some(OuterTop { z, roof: Texel(7) }) });
    assert!(build(MapColumn { clip: clip(20), ..good.clone() }).is_err(), "clipped without a strip");
    let strip =
        Some(WallStrip { texels: vec![Texel(1); usize::from(strip_rows(good.z_min, good.z_max, 0).1)], azimuth: 0 });
    assert!(build(MapColumn { clip: clip(good.z_min + 1), strip: strip.clone(), ..good.clone() }).is_ok());
    assert!(
        build(MapColumn { clip: clip(good.z_max), strip: strip.clone(), ..good.clone() }).is_err(),
        "outer top not lower"
    );
    assert!(
        build(MapColumn { clip: clip(good.z_min), strip, ..good.clone() }).is_err(),
        "outer top not above the bottom"
    );
    assert!(build(MapColumn { strip: Some(WallStrip::default()), ..good }).is_err(), "short strip");
}
