# Sourced by the other scripts: without a GPU, pins Mesa's software Vulkan driver. Packages bring the drivers of several
# vendors, and the loader may offer another one first.
if [ -z "${VK_DRIVER_FILES:-}" ] && ! compgen -G '/dev/dri/renderD*' >/dev/null && ! compgen -G '/dev/nvidia[0-9]*' >/dev/null; then
  for file in /usr/share/vulkan/icd.d/lvp_icd*.json; do
    if [ -e "$file" ]; then
      export VK_DRIVER_FILES=$file VK_ICD_FILENAMES=$file
      break
    fi
  done
fi
