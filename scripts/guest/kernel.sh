#!/usr/bin/env bash
# Fetches Debian's kernel and makes what QEMU boots, once: FOLDER/vmlinux (uncompressed, which boots faster) and
# FOLDER/initrd.img (busybox and the modules that the jobs need). usage: scripts/guest/kernel.sh FOLDER
set -euo pipefail
cd "$(dirname "$0")"
here=$PWD
folder=$1

# What the jobs load. dummy_hcd and the gadget functions make serial ports; the rest is USB and video.
modules="virtio_pci 9p 9pnet_virtio overlay vhci-hcd uvcvideo usbmon cdc-acm dummy_hcd libcomposite usb_f_acm vivid"

package=$(apt-cache depends linux-image-amd64 2>/dev/null | awk '/Depends:/ {print $2; exit}')
if [ -z "$package" ]; then
  echo "kernel.sh: no kernel package is known: run apt-get update" >&2
  exit 1
fi
stamp="$package $(cat kernel.sh init | sha256sum)"
[ -e "$folder/stamp" ] && [ "$(cat "$folder/stamp")" = "$stamp" ] && exit 0

rm -rf "$folder"
mkdir -p "$folder/debian"
cd "$folder"
echo "kernel.sh: fetching $package" >&2
apt-get download -qq "$package" 2>/dev/null
dpkg-deb -x "$package"_*.deb debian
rm "$package"_*.deb
version=$(ls debian/lib/modules)

# The kernel is an xz stream inside the boot image.
python3 - "debian/boot/vmlinuz-$version" vmlinux <<'P'
import lzma, sys
image = open(sys.argv[1], 'rb').read()
kernel = lzma.LZMADecompressor().decompress(image[image.find(b'\xfd7zXZ\0'):])
assert kernel[:4] == b'\x7fELF', 'no kernel in the boot image'
open(sys.argv[2], 'wb').write(kernel)
P

depmod -b "$PWD/debian" "$version"
root=$PWD/root
mkdir -p "$root"/{bin,proc,sys,dev,mnt,newroot,lib/modules/"$version"}
cp /bin/busybox "$root/bin/busybox"
for name in sh cp mount umount modprobe mkdir switch_root; do ln -s busybox "$root/bin/$name"; done
for module in $modules; do
  modprobe -d "$PWD/debian" -S "$version" -D $module
done | awk '$1 == "insmod" {print $2}' | sort -u | while read -r file; do
  inside=${file#*lib/modules/}
  mkdir -p "$root/lib/modules/$(dirname "$inside")"
  cp "$file" "$root/lib/modules/$inside"
done
cp debian/lib/modules/"$version"/modules.{order,builtin,builtin.modinfo} "$root/lib/modules/$version/"
depmod -b "$root" "$version"
install -m 755 "$here/init" "$root/init"
(cd "$root" && find . | cpio -o -H newc --quiet | gzip -1) >initrd.img
rm -rf debian root
echo "$stamp" >stamp
