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

# How true a bake is to its source: just fidelity FILE... --out DIR
fidelity *ARGS:
    cargo run --release -p insula-tests --bin fidelity -- {{ARGS}}
