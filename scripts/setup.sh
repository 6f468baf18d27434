#!/usr/bin/env bash
# Installs what erfgs needs on Debian 12 and what is missing only: a Vulkan driver that computes correctly without a
# GPU, COLMAP, ffmpeg, libusb; with --oracles, the Python environment that the cross-checks run in; with --emulation, what
# the emulated cameras are plugged into (QEMU, umockdev); with --browser, the one that pages are tested in (Chromium); with
# --hdf5, the library for the feature of that name; with --slurm, what sweeps are tested on. Safe to run again.
set -euo pipefail
cd "$(dirname "$0")/.."

oracles=no emulation=no browser=no hdf5=no slurm=no
for argument in "$@"; do
  case "$argument" in
    --oracles) oracles=yes ;;
    --emulation) emulation=yes ;;
    --browser) browser=yes ;;
    --hdf5) hdf5=yes ;;
    --slurm) slurm=yes ;;
    -h|--help) sed -n '2,5p' "$0"; echo "usage: scripts/setup.sh [--oracles] [--emulation] [--browser] [--hdf5] [--slurm]"; exit 0 ;;
    *) echo "setup.sh: unknown option $argument (see --help)" >&2; exit 2 ;;
  esac
done

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }
have() { dpkg-query -W -f='${Status}' "$1" 2>/dev/null | grep -q 'ok installed'; }

updated=no
update_once() {
  if [ "$updated" = no ]; then as_root apt-get update -qq; updated=yes; fi
}
install() { # install PACKAGE...: the ones that are missing
  local missing=()
  for package in "$@"; do have "$package" || missing+=("$package"); done
  [ ${#missing[@]} -eq 0 ] && return
  update_once
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
}

if ! command -v apt-get >/dev/null; then
  echo "setup.sh: this script knows Debian and Ubuntu. Elsewhere install a Vulkan driver, COLMAP (3.8 or 4.x) and" >&2
  echo "          ffmpeg by hand, then run 'erfgs doctor' to see what is still missing." >&2
  exit 1
fi

install build-essential pkg-config ca-certificates colmap ffmpeg libusb-1.0-0-dev libsqlite3-dev libzstd-dev

# Manual pages are read with it in the tests.
install groff-base

# The trigger board's firmware and its simulator; libclang reads the kernel's V4L2 header for the camera driver.
install gcc-avr avr-libc simavr libsimavr-dev libelf-dev libclang1-14 libclang-common-14-dev

if ! command -v cargo >/dev/null && [ ! -x "$HOME/.cargo/bin/cargo" ]; then
  echo "setup.sh: Rust is missing. Install it from https://rustup.rs and run this again." >&2
  exit 1
fi

# Debian 12's own lavapipe (22.3) ends every loop after 65,535 iterations without a word. Take Mesa 25 from backports.
mesa=$(dpkg-query -W -f='${Version}' mesa-vulkan-drivers 2>/dev/null || echo 0)
if dpkg --compare-versions "$mesa" lt 25; then
  . /etc/os-release
  release=()
  if [ "${VERSION_CODENAME:-}" = bookworm ]; then
    release=(-t bookworm-backports)
    # Where this machine's own sources get a release from, in whatever format they are written.
    source_of() { apt-get indextargets --format '$(RELEASE) $(REPO_URI)' 'Created-By: Packages' | awk -v release="$1" '$1 == release { print $2; exit }'; }
    update_once
    if [ -z "$(source_of bookworm-backports)" ]; then
      mirror=$(source_of bookworm)
      if [ -z "$mirror" ]; then
        echo "setup.sh: Mesa 25 comes from bookworm-backports, and none of this machine's apt sources is Debian 12 (bookworm), whose" >&2
        echo "          mirror would have it. Add bookworm-backports to the apt sources and run this again." >&2
        exit 1
      fi
      printf 'Types: deb\nURIs: %s\nSuites: bookworm-backports\nComponents: main\nSigned-By: /usr/share/keyrings/debian-archive-keyring.gpg\n' \
        "$mirror" | as_root tee /etc/apt/sources.list.d/bookworm-backports.sources >/dev/null
      updated=no
    fi
  fi
  update_once
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${release[@]}" mesa-vulkan-drivers libvulkan1
fi

if [ "$browser" = yes ]; then
  install chromium
fi

if [ "$hdf5" = yes ]; then
  install libhdf5-dev
fi

# No daemon of these is started here; the tests start their own, on the loopback.
if [ "$slurm" = yes ]; then
  install munge slurm-client slurmctld slurmd
fi

if [ "$oracles" = yes ]; then
  install python3 python3-venv
  venv=target/oracles
  stamp="$venv/requirements.stamp"
  if ! cmp -s tests/oracles/requirements.txt "$stamp"; then
    rm -rf "$venv"
    python3 -m venv "$venv"
    # What is never imported need not be compiled, which is half of the time; what is, would be compiled by each oracle anew, where the
    # environment says that Python shall keep nothing of it.
    "$venv/bin/pip" install --quiet --no-compile --disable-pip-version-check -r tests/oracles/requirements.txt
    env -u PYTHONDONTWRITEBYTECODE JAX_PLATFORMS=cpu "$venv/bin/python" -c 'import cv2, h5py, jax; jax.jit(jax.grad(lambda x: x * x))(1.0)'
    cp tests/oracles/requirements.txt "$stamp"
  fi
  "$venv/bin/python" tests/oracles/recordings.py target/recordings
fi

if [ "$emulation" = yes ]; then
  install busybox-static cpio kmod python3 umockdev libumockdev-dev libudev-dev v4l-utils aravis-tools-cli
  if ! have qemu-system-x86; then
    update_once
    qemu() { as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" qemu-system-x86; }
    # Parts of a newer QEMU from backports, where they are installed already, shut out the stable one.
    qemu 2>/dev/null || qemu -t "$(. /etc/os-release; echo "$VERSION_CODENAME")-backports"
  fi
fi
