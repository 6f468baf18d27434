# Sourced by the other scripts. Without a GPU, pins Mesa's software Vulkan driver: packages bring the drivers of several
# vendors, and the loader may offer another one first.
if [ -z "${VK_DRIVER_FILES:-}" ] && ! compgen -G '/dev/dri/renderD*' >/dev/null && ! compgen -G '/dev/nvidia[0-9]*' >/dev/null; then
  for file in /usr/share/vulkan/icd.d/lvp_icd*.json; do
    if [ -e "$file" ]; then
      export VK_DRIVER_FILES=$file VK_ICD_FILENAMES=$file
      break
    fi
  done
fi

# C libraries that scripts/setup.sh installed are linked, and not built: a minute of processor time less.
if command -v pkg-config >/dev/null; then
  if pkg-config --exists sqlite3; then export LIBSQLITE3_SYS_USE_PKG_CONFIG=1; fi
  if pkg-config --exists libzstd; then export ZSTD_SYS_USE_PKG_CONFIG=1; fi
fi

# The features that the whole workspace is built with here: HDF5 where its library is there.
export ERFGS_FEATURES=
if command -v pkg-config >/dev/null && pkg-config --exists hdf5; then ERFGS_FEATURES=hdf5; fi
