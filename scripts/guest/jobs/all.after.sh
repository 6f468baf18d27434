# Accounts for what the job show, the last of all, recorded. usage: all.after.sh FOLDER TEST-BINARY PROGRAMS (as of the job)
set -euo pipefail
bash "$(dirname "$0")/show.after.sh" "$1" "$3"
