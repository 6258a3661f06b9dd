//! Vertical datums that go with national map projections. They tell the geoid model for sources of one height system
//! and a city that only names its projection.

/// Code of the vertical datum of heights in a projected system, where a country has one of each. From the national
/// mapping agencies' recommendations, as in the compound systems of the EPSG registry.
pub(super) fn vertical_code(horizontal_code: u32) -> Option<u32> {
    Some(match horizontal_code {
        28_992 => 5709,                                  // Netherlands: NAP
        6669..=6687 => 6695,                             // Japan: JGD2011
        2443..=2461 => 6695,                             // Japan, JGD2000
        21_781 | 2056 => 5728,                           // Switzerland: LN02
        2154 | 3942..=3950 | 9793 | 9842..=9850 => 5720, // France: NGF-IGN69
        27_700 => 5701,                                  // Great Britain: ODN
        2193 => 7839,                                    // New Zealand: NZVD2016
        31_370 | 3812 => 5710,                           // Belgium: Ostend
        3006..=3018 => 5613,                             // Sweden: RH2000
        3067 | 3873..=3885 => 3900,                      // Finland: N2000
        5105..=5130 => 5941,                             // Norway: NN2000
        31_254..=31_259 | 31_284..=31_287 => 5778,       // Austria: GHA
        2176..=2180 => 9651,                             // Poland: EVRF2007
        5514 | 5513 => 8357,                             // Czechia, Slovakia: Baltic 1957
        3763 => 5780,                                    // Portugal: Cascais
        23_700 => 5787,                                  // Hungary: EOMA
        3794 => 8690,                                    // Slovenia: SVS2010
        8088 | 5325 | 3057 => 8089,                      // Iceland: ISH2004
        28_348..=28_358 | 7846..=7859 => 5711,           // Australia: AHD
        2046..=2055 => 9279,                             // South Africa: SA LLD
        _ => return None,
    })
}
