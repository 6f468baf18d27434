// Mouse, fingers and keys on the stage.

const TURN = 0.005;

// `camera()` gives the free camera, ready to be moved; `changed()` is told that it was.
export function listen(stage, camera, changed) {
  const fingers = new Map();
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return { at: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], apart: Math.hypot(a[0] - b[0], a[1] - b[1]) };
  };
  stage.addEventListener('contextmenu', (event) => event.preventDefault());
  stage.addEventListener('pointerdown', (down) => {
    stage.setPointerCapture(down.pointerId);
    fingers.set(down.pointerId, [down.clientX, down.clientY]);
  });
  const up = (event) => fingers.delete(event.pointerId);
  stage.addEventListener('pointerup', up);
  stage.addEventListener('pointercancel', up);
  stage.addEventListener('pointermove', (move) => {
    const last = fingers.get(move.pointerId);
    if (!last) return;
    const [dx, dy] = [move.clientX - last[0], move.clientY - last[1]];
    if (dx === 0 && dy === 0) return;
    const free = camera();
    const share = 1 / Math.max(1, stage.clientHeight);
    if (fingers.size === 2) {
      const before = spread();
      fingers.set(move.pointerId, [move.clientX, move.clientY]);
      const after = spread();
      free.zoom(before.apart / Math.max(1, after.apart));
      free.move(-share * (after.at[0] - before.at[0]), -share * (after.at[1] - before.at[1]), 0);
    } else {
      fingers.set(move.pointerId, [move.clientX, move.clientY]);
      if (move.shiftKey || move.buttons & 2) free.move(-share * dx, -share * dy, 0);
      else if (move.ctrlKey || move.buttons & 4) free.look(TURN * dx, TURN * dy);
      else free.turn(-TURN * dx, TURN * dy);
    }
    changed();
  });
  stage.addEventListener('wheel', (wheel) => {
    wheel.preventDefault();
    camera().zoom(Math.exp(0.001 * wheel.deltaY));
    changed();
  }, { passive: false });

  // Keys that are held fly.
  const held = new Set();
  const ways = { w: [0, 0, 1], s: [0, 0, -1], a: [-1, 0, 0], d: [1, 0, 0], q: [0, 1, 0], e: [0, -1, 0] };
  const typing = (event) => event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT)$/.test(event.target.tagName);
  addEventListener('keydown', (event) => { if (!typing(event) && ways[event.key]) held.add(event.key); });
  addEventListener('keyup', (event) => held.delete(event.key));
  addEventListener('blur', () => held.clear());
  return {
    // Moves by what was held for so many seconds.
    fly(seconds) {
      if (held.size === 0) return;
      const way = [...held].map((key) => ways[key]).reduce((sum, way) => sum.map((v, i) => v + way[i]));
      camera().move(...way.map((v) => 0.6 * seconds * v));
      changed();
    },
    typing,
  };
}
