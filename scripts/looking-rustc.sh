#!/usr/bin/env bash
# A compiler that looks at a crate as any does, and makes no code of it: for RUSTC_WORKSPACE_WRAPPER, where a crate is compiled that
# nobody runs, with others that were built.
# usage: looking-rustc.sh RUSTC [ARGUMENT...]
set -euo pipefail

arguments=() previous='' form='' folder='' extra=''
for argument in "$@"; do
  case $previous=$argument in
    --crate-type=*) form=$argument ;;
    --out-dir=*) folder=$argument ;;
    -C=extra-filename=*) extra=${argument#*=} ;;
    =--emit=*) argument=--emit=dep-info,metadata ;;
  esac
  previous=
  case $argument in --crate-type | --out-dir | -C) previous=$argument ;; esac
  arguments+=("$argument")
done
"${arguments[@]}"

# Cargo would ask for it again if there were no library.
if [ "$form" = lib ]; then touch "$folder/lib$CARGO_CRATE_NAME$extra.rlib"; fi
