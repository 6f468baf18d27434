# The camera drivers against vivid, the kernel's virtual cameras. usage: run.sh cameras TEST-BINARY (that of the test
# guest_cameras of erfgs-rig, as `cargo test --no-run` names it)
set -euo pipefail
modprobe vivid n_devs=2 node_types=0x1,0x1 num_inputs=1,1 input_types=0x00,0x00 vid_cap_nr=0,10
# Nothing but the bars: text would be in the colours that are compared.
v4l2-ctl -d /dev/video0 --set-ctrl osd_text_mode=2
"$1" --ignored --test-threads 1 --nocapture
