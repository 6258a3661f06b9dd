//! Prints irradiances of clear skies as CSV, for `tests/load/irradiance.py`. `depth` is the optical depth of the particles at
//! 0.55 micrometres.
//!
//! `cargo run --release -p insula-measure --bin irradiance -- [TURBIDITIES] [HEIGHTS]`, for instance `2,3,4 5,30,90`: heights
//! of the sun over the horizon in degrees, with refraction.

use insula_shaders::irradiance::ClearAir;
use std::num::ParseFloatError;

const TURBIDITIES: &str = "2,3,4,5,6";
const HEIGHTS_DEG: &str = "5,10,15,20,25,30,40,50,60,70,80,90";

fn main() -> Result<(), ParseFloatError> {
    let list = |k: usize, default: &str| -> Result<Vec<f64>, ParseFloatError> {
        let typed = std::env::args().nth(k).unwrap_or_else(|| default.to_owned());
        typed.split(',').map(|number| number.trim().parse()).collect()
    };
    let (turbidities, heights_deg) = (list(1, TURBIDITIES)?, list(2, HEIGHTS_DEG)?);
    println!("turbidity,depth,water_cm,height_deg,direct_normal_w_m2,diffuse_w_m2,global_w_m2");
    for turbidity in turbidities {
        let air = ClearAir::new(turbidity);
        for height_deg in &heights_deg {
            let sky = air.sky(height_deg.to_radians());
            let [direct, diffuse, global] = [sky.direct_normal_w_m2, sky.diffuse_w_m2, sky.global_w_m2];
            println!(
                "{turbidity},{:.4},{:.3},{height_deg},{direct:.2},{diffuse:.2},{global:.2}",
                air.depth, air.water_cm
            );
        }
    }
    Ok(())
}
