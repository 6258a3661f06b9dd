//! Values of a city that is computed part by part.

use crate::buildings::{BuildingValues, CityValues, PlaceValues};
use crate::surface::Building;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The values of a part of a city, as files keep them: those of buildings with a value, and of all places by their kind.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TileValues {
    ground: PlaceNumbers,
    roofs: PlaceNumbers,
    walls: PlaceNumbers,
    buildings: Vec<TileBuilding>,
}

/// Count, least, most, sum, and how many reach what is asked for.
type PlaceNumbers = [f64; 5];

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct TileBuilding {
    number: u32,
    identifier: String,
    roof: PlaceNumbers,
    walls: PlaceNumbers,
    roof_area_m2: f64,
    roof_total: f64,
}

impl TileValues {
    /// The values of a part.
    #[must_use]
    pub fn of(city: &CityValues<'_>) -> Self {
        let building = |row: &BuildingValues<'_>| TileBuilding {
            number: row.building.number,
            identifier: row.building.identifier.clone(),
            roof: row.roof.to_numbers(),
            walls: row.walls.to_numbers(),
            roof_area_m2: row.roof_area_m2,
            roof_total: row.roof_total,
        };
        let with_values = city.buildings.iter().filter(|row| row.roof.count + row.walls.count > 0);
        Self {
            ground: city.ground.to_numbers(),
            roofs: city.roofs.to_numbers(),
            walls: city.walls.to_numbers(),
            buildings: with_values.map(building).collect(),
        }
    }
}

/// The values of several parts together. Of a building in two parts, they are one.
#[derive(Debug, Default)]
pub struct GatheredValues {
    ground: PlaceValues,
    roofs: PlaceValues,
    walls: PlaceValues,
    /// By their numbers.
    buildings: BTreeMap<u32, GatheredBuilding>,
}

#[derive(Debug)]
struct GatheredBuilding {
    building: Building,
    roof: PlaceValues,
    walls: PlaceValues,
    roof_area_m2: f64,
    roof_total: f64,
}

impl GatheredValues {
    /// Adds a part, with its buildings or without.
    pub fn add(&mut self, part: TileValues, has_buildings: bool) {
        let pairs = [(&mut self.ground, part.ground), (&mut self.roofs, part.roofs), (&mut self.walls, part.walls)];
        for (all, numbers) in pairs {
            all.join(PlaceValues::of_numbers(numbers));
        }
        for row in part.buildings.into_iter().filter(|_| has_buildings) {
            let TileBuilding { number, identifier, .. } = row;
            let all = self.buildings.entry(number).or_insert_with(|| GatheredBuilding {
                building: Building { number, identifier },
                roof: PlaceValues::default(),
                walls: PlaceValues::default(),
                roof_area_m2: 0.0,
                roof_total: 0.0,
            });
            all.roof.join(PlaceValues::of_numbers(row.roof));
            all.walls.join(PlaceValues::of_numbers(row.walls));
            all.roof_area_m2 += row.roof_area_m2;
            all.roof_total += row.roof_total;
        }
    }

    /// All of them.
    #[must_use]
    pub fn city(&self) -> CityValues<'_> {
        let buildings = self.buildings.values().map(|row| BuildingValues {
            building: &row.building,
            roof: row.roof,
            walls: row.walls,
            roof_area_m2: row.roof_area_m2,
            roof_total: row.roof_total,
        });
        CityValues { buildings: buildings.collect(), ground: self.ground, roofs: self.roofs, walls: self.walls }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::buildings::sum_up;
    use crate::surface::{CitySurface, TopKind};
    use crate::walls::WallPoint;

    #[test]
    fn parts_together_are_the_whole() {
        let kinds = [TopKind::Ground, TopKind::Roof(0), TopKind::Roof(0), TopKind::Ground];
        let surface = CitySurface::of_cells([4, 1], [0.0; 2], 0.0, vec![0.0, 9.0, 9.0, 0.0], &kinds);
        let values = [1.0, 2.0, 4.0, 3.0];
        let point = WallPoint { cell: 0, height_m: 1.0, azimuth_deg: 0.0, building: 0 };
        let whole = sum_up(&surface, &values, &[point], &[5.0], Some(2.0));
        let part = |from: usize, to: usize, points: &[WallPoint], walls: &[f32]| {
            let is_in = |index: usize| (from..to).contains(&index);
            let tops: Vec<f32> = (0..4).map(|index| if is_in(index) { values[index] } else { f32::NAN }).collect();
            let part = TileValues::of(&sum_up(&surface, &tops, points, walls, Some(2.0)));
            // As files keep it.
            toml::from_str::<TileValues>(&toml::to_string(&part).unwrap()).unwrap()
        };
        let mut gathered = GatheredValues::default();
        gathered.add(part(0, 2, &[point], &[5.0]), true);
        gathered.add(part(2, 4, &[], &[]), true);
        gathered.add(TileValues::default(), true);
        let city = gathered.city();
        assert_eq!((city.ground, city.roofs, city.walls), (whole.ground, whole.roofs, whole.walls));
        let [building, expected] = [&city.buildings, &whole.buildings].map(|rows| rows[0].clone());
        assert_eq!((building.roof, building.walls), (expected.roof, expected.walls));
        assert_eq!((building.building, building.roof_total), (expected.building, expected.roof_total));
        assert_eq!(city.buildings.len(), 1);
    }
}
