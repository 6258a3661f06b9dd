//! Maps in, objects out; faulty and hostile files.

mod areas;
mod building_parts;
mod hostile;
mod map;
mod objects;
