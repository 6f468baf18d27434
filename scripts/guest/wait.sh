# Sourced by jobs: waiting that starts no process for each look, of which an emulated processor starts few in a second.
shopt -s nullglob extglob
[ -p /run/never ] || mkfifo /run/never
exec {never}<>/run/never

rest() { read -rt "$1" -u "$never" || true; } # rest SECONDS

wait_for() { # wait_for WHAT CONDITION...
  local what=$1 try
  shift
  for try in {1..1200}; do "$@" && return; rest 0.1; done
  echo "there is no $what after 2 minutes"
  exit 1
}

on_the_bus() { # on_the_bus COUNT: whether there are so many USB devices
  local devices=(/sys/bus/usb/devices/+([0-9])-+([0-9]))
  [ ${#devices[@]} = "$1" ]
}
