# Headless training and replay on a machine with a GPU, or without one on Mesa's software driver. Not built by .ci/run.
#   docker build --build-arg ERFGS_COMMIT=$(git rev-parse HEAD) -t erfgs .
#   docker run --rm --gpus all -e NVIDIA_DRIVER_CAPABILITIES=all -v $PWD:/work erfgs train ds --out run
FROM rust:1.95-trixie AS build
RUN apt-get update -qq \
 && apt-get install -y -qq --no-install-recommends cmake libusb-1.0-0-dev libclang-dev pkg-config \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY . .
# The commit that `erfgs --version` names: the context has no .git.
ARG ERFGS_COMMIT=
ENV ERFGS_COMMIT=$ERFGS_COMMIT CARGO_INCREMENTAL=0
RUN cargo build --release --locked -p erfgs --features hdf5-static --bin erfgs && strip target/release/erfgs

FROM debian:trixie-slim
# Mesa 25: the lavapipe of Debian 12 ends long loops without a word.
RUN apt-get update -qq \
 && apt-get install -y -qq --no-install-recommends colmap ffmpeg libusb-1.0-0 libvulkan1 mesa-vulkan-drivers \
 && rm -rf /var/lib/apt/lists/*
COPY --from=build /source/target/release/erfgs /usr/local/bin/erfgs
COPY LICENSE-APACHE LICENSE-MIT /usr/share/doc/erfgs/
# Files that a run writes belong to whoever mounts the folder: docker run --user $(id -u):$(id -g)
WORKDIR /work
ENTRYPOINT ["erfgs"]
CMD ["--help"]
