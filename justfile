# Recipes for developers. `just` runs what CI runs.

profile := "ci"

# Checks everything in the quick tier, as CI does.
all:
    .ci/run

# Checks everything in the full tier: all sizes, fuzzing, long kills. Run it before a release.
full:
    CI_FULL=1 .ci/run

# One step of CI: setup, fmt, web, lint, deny, build, test or fuzz.
ci STEP:
    .ci/run {{STEP}}

# The viewer of the pages, and the release programs with it.
dist:
    client/web/build
    cargo build --release

# Runs the tests that a changed file concerns (by default, of all files that differ from HEAD), or those of a crate.
t *CHANGED:
    tests/tools/affected.py --profile {{profile}} {{CHANGED}}

# Runs a measuring program: just measure fidelity --out DIR FILE...
measure NAME *ARGS:
    cargo run --release -p insula-measure --bin {{NAME}} -- {{ARGS}}

# The long run of the fuzz targets: just fuzz 600 [TARGET...]
fuzz *ARGS:
    tests/fuzz/run {{ARGS}}

# Alternating measurements of Insula and nginx with the same tiles: just throughput CITY [--tls]
throughput *ARGS:
    cargo build --profile dist -p insula-server --no-default-features
    cargo build --release -p insula-measure --bin tile_files
    tests/load/throughput.py --server "${CARGO_TARGET_DIR:-target}/dist/insula-server" {{ARGS}}

# All load measurements: viewers, nginx, overload: just load CITY --out DIR
load *ARGS:
    cargo build --release --bin insula --bin insula-server
    cargo build --release -p insula-measure --bin tile_files
    cd tests/load && cargo build --release
    tests/load/run.py {{ARGS}}

# Debian packages and a tarball of both programs: just package OUT
package OUT:
    docker/package/build {{OUT}}

# Installs the packages in a new Debian, bakes and serves there: sudo just package-smoke OUT
package-smoke OUT:
    docker/package/smoke {{OUT}}
