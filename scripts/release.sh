#!/usr/bin/env bash
# Makes a release for Linux on x86-64: the program as a tarball and as a Debian package, the Python wheel, the bill of materials and
# checksums, all in target/release-VERSION. scripts/try-release.sh installs what came of it on a bare Debian.
# usage: scripts/release.sh [--profile PROFILE] VERSION
#   VERSION    that of Cargo.toml, which has a part of its own in CHANGELOG.md
#   --profile  cargo's profile (default: release); with another one the version need not be in CHANGELOG.md, for trying this script
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "release.sh: $1" >&2; exit "${2:-1}"; }
profile=release version=
while [ $# -gt 0 ]; do
  case $1 in
    -h | --help) sed -n '2,6p' "$0" | cut -c3-; exit 0 ;;
    --profile) profile=${2:?"release.sh: --profile needs a name"}; shift 2 ;;
    -*) fail "unknown option $1 (see --help)" 2 ;;
    *) [ -z "$version" ] || fail "one version, not two (see --help)" 2; version=$1; shift ;;
  esac
done
[ -n "$version" ] || fail "which version? (see --help)" 2
stated=$(sed -n '/^\[workspace.package\]/,$s/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
[ "$version" = "$stated" ] || fail "Cargo.toml has version $stated: change it there first, and commit"
if [ "$profile" = release ]; then
  grep -q "^## \[\?$version\]\? " CHANGELOG.md || fail "CHANGELOG.md has no '## $version - DATE': name what is under 'Unreleased' so"
  [ -z "$(git status --porcelain)" ] || fail "the checkout has changes: a release is of a commit"
fi
for tool in dpkg-deb dpkg-shlibdeps python3 strip; do
  command -v $tool >/dev/null || fail "$tool is missing: apt-get install dpkg-dev python3-venv binutils"
done

target=${CARGO_TARGET_DIR:-$PWD/target}
out=$target/release-$version
export CARGO_INCREMENTAL=0 SOURCE_DATE_EPOCH
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
# Linked into the program, and not those of this machine.
unset LIBSQLITE3_SYS_USE_PKG_CONFIG ZSTD_SYS_USE_PKG_CONFIG
# HDF5 asks for a newer CMake than Debian 12 has.
maturin=1.16.0 cmake=3.31.10 wheel=0.45.1 tools=$target/release-tools
if [ "$(cat "$tools/stamp" 2>/dev/null)" != "$maturin $cmake $wheel" ]; then
  python3 -m venv --clear "$tools"
  "$tools/bin/pip" install --quiet --disable-pip-version-check "maturin==$maturin" "cmake==$cmake" "wheel==$wheel"
  echo "$maturin $cmake $wheel" >"$tools/stamp"
fi
export CMAKE=$tools/bin/cmake
rm -rf "$out"
mkdir -p "$out"

echo "== the program"
cargo build --locked --profile "$profile" -p erfgs --features hdf5-static --bin erfgs
built=$target/$profile/erfgs
[ "$profile" != dev ] || built=$target/debug/erfgs

# What lies below /usr or a prefix, wherever that is.
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
install -D -m 755 "$built" "$tree/bin/erfgs"
strip "$tree/bin/erfgs"
erfgs=$tree/bin/erfgs
install -D -m 644 /dev/stdin "$tree/share/bash-completion/completions/erfgs" < <("$erfgs" completions bash)
install -D -m 644 /dev/stdin "$tree/share/zsh/vendor-completions/_erfgs" < <("$erfgs" completions zsh)
install -D -m 644 /dev/stdin "$tree/share/fish/vendor_completions.d/erfgs.fish" < <("$erfgs" completions fish)
"$erfgs" man --quiet "$tree/share/man/man1" >/dev/null
install -D -m 644 -t "$tree/share/doc/erfgs" README.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT
install -D -m 644 scripts/udev/60-erfgs.rules "$tree/lib/udev/rules.d/60-erfgs.rules"
scripts/sbom.py erfgs hdf5-static "$version" "$tree/share/doc/erfgs"
cp "$tree/share/doc/erfgs/erfgs-$version.cdx.json" "$out"

echo "== the tarball"
name=erfgs-$version-x86_64-linux
tar -C "$tree" --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$SOURCE_DATE_EPOCH" --transform "s,^\.,$name," -czf "$out/$name.tar.gz" .

# By dpkg-deb, which every Debian has: cargo-deb would have to be compiled for it, and one program with its data needs no more.
echo "== the Debian package"
root=$tree.deb
unpacked=$tree.wheel
trap 'rm -rf "$tree" "$root" "$unpacked"' EXIT
mkdir -p "$root/DEBIAN"
cp -r "$tree" "$root/usr"
gzip -9n "$root"/usr/share/man/man1/*.1 "$root/usr/share/doc/erfgs/CHANGELOG.md"
mv "$root/usr/share/doc/erfgs/CHANGELOG.md.gz" "$root/usr/share/doc/erfgs/changelog.gz"
rm "$root"/usr/share/doc/erfgs/LICENSE-*
{
  printf 'Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\nUpstream-Name: erfgs\n\nFiles: *\nCopyright: the authors of erfgs\nLicense: MIT or Apache-2.0\n\nLicense: MIT\n'
  sed 's/^$/./; s/^/ /' LICENSE-MIT
  printf '\nLicense: Apache-2.0\n On Debian systems, the license is in /usr/share/common-licenses/Apache-2.0.\n'
} >"$root/usr/share/doc/erfgs/copyright"
mkdir -p "$root/debian"
printf 'Source: erfgs\n\nPackage: erfgs\nArchitecture: amd64\n' >"$root/debian/control"
depends=$(cd "$root" && dpkg-shlibdeps -O usr/bin/erfgs 2>/dev/null | sed -n 's/^shlibs:Depends=//p')
rm -r "$root/debian"
[ -n "$depends" ] || fail "dpkg-shlibdeps does not say what the program depends on"
cat >"$root/DEBIAN/control" <<CONTROL
Package: erfgs
Version: $version
Architecture: amd64
Maintainer: the authors of erfgs <erfgs@localhost>
Installed-Size: $(du -sk "$root/usr" | cut -f 1)
Depends: $depends
Recommends: libvulkan1, mesa-vulkan-drivers | vulkan-icd, ffmpeg, colmap
Section: science
Priority: optional
Description: from synchronized RGB and event cameras to a sharp 4D reconstruction
 Records a rig of frame and event cameras, calibrates it, reconstructs what
 moved before it as dynamic 3D Gaussians, and shows that in a browser.
CONTROL
printf '#!/bin/sh\nset -e\n# New rules hold for cameras that are plugged in from now on.\nif command -v udevadm >/dev/null; then udevadm control --reload || true; fi\n' \
  | tee "$root/DEBIAN/postinst" >"$root/DEBIAN/postrm"
chmod 755 "$root/DEBIAN/postinst" "$root/DEBIAN/postrm"
find "$root" -type d -exec chmod 755 {} +
dpkg-deb --root-owner-group --build "$root" "$out/erfgs_${version}_amd64.deb" >/dev/null

echo "== the wheel, with the program in it"
(cd python && "$tools/bin/maturin" build --quiet --profile "$profile" --locked --features hdf5-static --out "$unpacked")
"$tools/bin/wheel" unpack --dest "$unpacked" "$unpacked"/erfgs-*.whl >/dev/null
wheel_data=$unpacked/erfgs-$version/erfgs-$version.data
install -D -m 755 "$erfgs" "$wheel_data/scripts/erfgs"
install -D -m 644 "$tree/share/doc/erfgs/THIRD-PARTY.txt" "$wheel_data/data/share/doc/erfgs/THIRD-PARTY.txt"
"$tools/bin/wheel" pack --dest-dir "$out" "$unpacked/erfgs-$version" >/dev/null

(cd "$out" && sha256sum -- * >SHA256SUMS)
echo "== $out"
ls -l "$out"
