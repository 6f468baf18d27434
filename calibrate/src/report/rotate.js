// Turns the picture of the rig as it is dragged: lines are given as pairs of points in space.
for (const svg of document.querySelectorAll(".space svg")) {
  const lines = [...svg.querySelectorAll("path")], names = [...svg.querySelectorAll("text[data-point]")];
  let [turn, tilt] = [Number(svg.dataset.turn), Number(svg.dataset.tilt)];
  const place = ([x, y, z]) => {
    const across = x * Math.cos(turn) + z * Math.sin(turn), away = z * Math.cos(turn) - x * Math.sin(turn);
    return [across, y * Math.cos(tilt) - away * Math.sin(tilt)];
  };
  const draw = () => {
    for (const line of lines) {
      const points = JSON.parse(line.dataset.points).map(place);
      line.setAttribute("d", points.map(([x, y], i) => `${i % 2 ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join(""));
    }
    for (const name of names) {
      const [x, y] = place(JSON.parse(name.dataset.point));
      name.setAttribute("x", x); name.setAttribute("y", y - 6);
    }
  };
  let from = null;
  svg.addEventListener("pointerdown", (event) => { from = event; svg.setPointerCapture(event.pointerId); });
  svg.addEventListener("pointerup", () => { from = null; });
  svg.addEventListener("pointermove", (event) => {
    if (!from) return;
    turn += (event.clientX - from.clientX) / 200;
    tilt = Math.max(-1.57, Math.min(1.57, tilt + (event.clientY - from.clientY) / 200));
    from = event;
    draw();
  });
}
