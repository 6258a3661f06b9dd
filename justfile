# The steps of CI, one recipe each: `just` runs them all, as `.ci/run` does.

all:
    .ci/run

# Vulkan without a GPU, a screen without a screen (Debian, Ubuntu).
setup:
    .ci/run setup

fmt:
    .ci/run fmt

lint:
    .ci/run lint

deny:
    .ci/run deny

test:
    .ci/run test

# The long run of the fuzz targets: just fuzz 600 [TARGET...]
fuzz *ARGS:
    tests/fuzz/run {{ARGS}}

# Insula and nginx with the same tiles, in turn: just throughput CITY [--tls]
throughput *ARGS:
    cargo build --profile dist -p insula-server --no-default-features
    cargo build --release -p insula-server --example tile_files
    tests/load/throughput.py --server "${CARGO_TARGET_DIR:-target}/dist/insula-server" {{ARGS}}

# Viewers, nginx, overload: all that is measured of a server under load: just load CITY --out DIR
load *ARGS:
    cargo build --release --bin insula --bin insula-server
    cargo build --release -p insula-server --example tile_files
    cd tests/load && cargo build --release --features scenarios
    tests/load/run.py {{ARGS}}

# How true a bake is to its source: just fidelity FILE... --out DIR
fidelity *ARGS:
    cargo run --release -p insula-tests --bin fidelity -- {{ARGS}}
