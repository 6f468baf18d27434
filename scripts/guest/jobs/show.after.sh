# Accounts for every byte and every pulse of what the job show recorded. It runs on the host, where the emulated processor's speed
# does not matter. usage: show.after.sh FOLDER [PROGRAMS]   (FOLDER: what the job left; PROGRAMS: as of the job)
set -euo pipefail
folder=$1
programs=${2:-target/debug}
"$programs/erfgs" info "$folder/s.mcap"
"$programs/erfgs" sync "$folder/s.mcap"
python3 tests/guest/account.py "$folder" left=left:81 right=right:81 davis=davis:82 \
  cam0=cam0:81 cam1=cam1:81 cam2=cam2:81 cam3=cam3:81
