# The steps of CI, one recipe each: `just` runs them all, as `.ci/run` does.

all:
    .ci/run

# Installs a software Vulkan driver and a virtual display (Debian, Ubuntu).
setup:
    .ci/run setup

fmt:
    .ci/run fmt

# The browser viewer, which the server embeds when it is built next.
web:
    .ci/run web

lint:
    .ci/run lint

deny:
    .ci/run deny

test:
    .ci/run test

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
    cd tests/load && cargo build --release --features scenarios
    tests/load/run.py {{ARGS}}

# Accuracy of a bake against its source: just fidelity FILE... --out DIR
fidelity *ARGS:
    cargo run --release -p insula-measure --bin fidelity -- {{ARGS}}

# Debian packages and a tarball of both programs: just package OUT
package OUT:
    docker/package/build {{OUT}}

# Installs the packages in a new Debian, bakes and serves there: sudo just package-smoke OUT
package-smoke OUT:
    docker/package/smoke {{OUT}}
