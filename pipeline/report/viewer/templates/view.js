"use strict";
const at = id => document.getElementById(id);
const FILTERS = ["task", "robot", "level", "domain", "outcome"];
const COLOURS = {"left touches": "#93c5fd", "right touches": "#fcd34d", "left holds": "#2563eb", "right holds": "#d97706"};
const loaded = new Map();
let shown = null, data = null, frame = 0, timer = null, listed = [], begin = 0, saving = null;
var DOMINO, PLOTLY;

// all images of the episode, beside each other; it is never seen itself, its parts are drawn when it shows the frame
const film = Object.assign(document.createElement("video"), {muted: true, preload: "auto"});
film.onseeked = () => Object.entries(data.cameras).forEach(([name, camera]) => draw(name, camera));
film.onerror = () => at("why").textContent = "this browser cannot play the film of the episode, which is H.264";

function add(parent, tag, text, attributes) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  Object.assign(made, attributes || {});
  parent.appendChild(made);
  return made;
}

async function start() {
  const packed = Uint8Array.from(atob(PLOTLY), c => c.charCodeAt(0));
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  add(document.head, "script", await new Response(plain).text());
  for (const name of FILTERS) {
    const values = [...new Set(DOMINO.episodes.map(e => e[name]))].sort();
    for (const value of ["all", ...values]) add(at(name), "option", value);
    at(name).onchange = wall;
  }
  at("slow").oninput = at("fast").oninput = wall;
  at("to-wall").onclick = wall;
  at("to-failures").onclick = failures;
  window.onhashchange = follow;
  wall_();
  follow();
}

// A link names an episode by its file, so that it holds for every page and server of the dataset: #episode=FILE&frame=N
function follow() {
  // a plus in the name of a robot is a plus: this address is no form
  const asked = new URLSearchParams(location.hash.slice(1).replaceAll("+", "%2B")), file = asked.get("episode");
  if (file === null) return;
  const number = DOMINO.episodes.findIndex(e => e.file === file), wanted = Math.max(0, parseInt(asked.get("frame")) || 0);
  if (number < 0) return at("count").textContent = `${file} is not on this page: use view --serve, which shows all episodes`;
  if (number === shown && !at("episode").hidden) return data && go(wanted);
  open_(number, wanted);
}

function link() {
  clearTimeout(saving);  // browsers refuse a change of the address for every frame
  saving = setTimeout(() => {
    if (at("episode").hidden || timer) return;
    const file = encodeURIComponent(data.file).replaceAll("%2F", "/");
    history.replaceState(null, "", `#episode=${file}&frame=${frame}`);
  }, 200);
}

function only(id) {
  for (const section of ["wall", "failures", "episode"]) at(section).hidden = section !== id;
  if (id !== "episode") stop();
}

function wanted(e) {
  const slow = parseFloat(at("slow").value), fast = parseFloat(at("fast").value);
  return FILTERS.every(n => at(n).value === "all" || String(e[n]) === at(n).value)
    && !(e.speed < slow) && !(e.speed > fast);
}

function wall() {
  history.replaceState(null, "", "#");
  wall_();
}

function wall_() {
  only("wall");
  listed = DOMINO.episodes.map((e, i) => i).filter(i => wanted(DOMINO.episodes[i]));
  at("count").textContent = `${listed.length} of ${DOMINO.episodes.length} episodes` +
    (DOMINO.total > DOMINO.episodes.length ? `, chosen from ${DOMINO.total}` : "");
  at("wall").replaceChildren();
  for (const i of listed) {
    const e = DOMINO.episodes[i], figure = add(at("wall"), "figure");
    figure.onclick = () => open_(i);
    add(figure, "img", undefined, {src: e.image, loading: "lazy"});
    add(figure, "figcaption", `${e.task.replaceAll("_", " ")} · ${e.robot} · L${e.level} · ${e.speed.toFixed(2)} m/s · ${e.slot}`);
    if (e.failure) add(figure, "figcaption", `failed: ${e.failure}`, {className: "failed"});
  }
}

function failures() {
  only("failures");
  const box = at("failures");
  box.replaceChildren();
  const rows = DOMINO.failures.filter(f => FILTERS.filter(n => n !== "outcome").every(n =>
    at(n).value === "all" || String(f[n === "robot" ? "embodiment" : n]) === at(n).value));
  add(box, "h2", rows.length ? `${rows.length} attempts that failed` : "no attempt failed");
  if (!rows.length) return;
  const table = add(box, "table"), keys = ["task", "embodiment", "level", "slot", "attempt", "seed", "stage", "reason", "detail", "conditions"];
  const head = add(table, "tr");
  for (const key of keys) add(head, "th", key);
  for (const row of rows) {
    const line = add(table, "tr");
    for (const key of keys) add(line, "td", key === "conditions" ? (row[key] || []).join(", ") : row[key]);
    const kept = DOMINO.episodes.findIndex(e => e.outcome === "failed" && e.task === row.task && e.robot === row.embodiment
      && e.level === row.level && e.domain === row.domain && e.slot === row.slot && e.attempt === row.attempt);
    if (kept >= 0) add(add(line, "td"), "a", "watch", {onclick: () => open_(kept)});
  }
}

function open_(number, first = 0) {
  shown = number;
  begin = first;
  if (loaded.has(number)) return show(loaded.get(number));
  add(document.body, "script", undefined, {src: `episode_${number}.js`});
}

function episodeLoaded(number, values) {
  loaded.set(number, values);
  if (number === shown) show(values);
}

async function show(values) {
  stop();
  data = values;
  only("episode");
  at("title").textContent = data.file;
  at("instruction").textContent = data.instruction.join("");
  at("why").textContent = data.failure && `failed in ${data.failure}`;
  at("frame").max = data.frames - 1;
  at("cameras").replaceChildren();
  for (const name of Object.keys(data.cameras)) {
    const figure = add(at("cameras"), "figure"), [, , width, height] = data.boxes[name];
    add(figure, "canvas", undefined, {id: `canvas-${name}`, width, height});
    add(figure, "figcaption", name.replaceAll("_", " "));
  }
  const shows = {"show-masks": Object.values(data.cameras).some(camera => camera.outlines.length),
    "show-flow": Object.keys(data.boxes).some(name => name.endsWith(" flow"))};
  for (const [id, there] of Object.entries(shows)) at(id).parentElement.hidden = !there;
  film.src = data.film;
  timeline();
  at("joint").replaceChildren();
  data.joints.forEach((joint, i) => add(at("joint"), "option", joint, {value: i}));
  at("joint").onchange = curve;
  at("joint").value = busiest();
  space();
  curve();
  const seconds = data.speed.map((_, t) => t / data.fps);
  Plotly.newPlot("speed", [{x: seconds, y: data.speed, line: {color: "#059669"}}], layout("speed of the target (m/s)"), {displayModeBar: false});
  go(begin);
}

// The arm joint whose angle covers the widest range; grippers have another unit.
function busiest() {
  const range = row => Math.max(...row) - Math.min(...row);
  const arms = data.joints.map((_, i) => i).filter(i => !data.joints[i].endsWith("gripper"));
  return arms.reduce((best, i) => range(data.state[i]) > range(data.state[best]) ? i : best, arms[0] ?? 0);
}

const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const look = () => ({paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: {color: colour("--ink")}});
const axis = title => ({title: {text: title, standoff: 0}, gridcolor: colour("--line"), zerolinecolor: colour("--line")});
const layout = title => ({...look(), title: {text: title, font: {size: 12}}, margin: {l: 45, r: 10, t: 28, b: 30}, showlegend: false,
  xaxis: axis("s"), yaxis: axis(""), shapes: [now()]});
const now = () => ({type: "line", x0: frame / data.fps, x1: frame / data.fps, y0: 0, y1: 1, yref: "paper", line: {color: colour("--ink"), width: 1}});

function curve() {
  const i = Number(at("joint").value), seconds = data.speed.map((_, t) => t / data.fps);
  const lines = [{x: seconds, y: data.state[i], name: "state", line: {color: "#2563eb"}},
    {x: seconds, y: data.action[i], name: "action", line: {color: "#d97706", dash: "dot"}}];
  Plotly.newPlot("curve", lines, {...layout(`${data.joints[i]}: state, action (dotted)`)}, {displayModeBar: false});
}

function space() {
  const line = (path, name, color, dash) => ({type: "scatter3d", mode: "lines", x: path[0], y: path[1], z: path[2], name, line: {color, width: 4, dash}});
  const place = data.meeting.place;
  const traces = [line(data.path.planned, "planned", "#9ca3af", "dash"), line(data.path.target, "target", "#059669"),
    line(data.hands.left, "left hand", "#2563eb"), line(data.hands.right, "right hand", "#d97706"),
    {type: "scatter3d", mode: "markers", x: [place[0]], y: [place[1]], z: [place[2]], name: "meeting", marker: {size: 5, color: "#b91c1c"}},
    {type: "scatter3d", mode: "markers", x: [0, 0, 0], y: [0, 0, 0], z: [0, 0, 0], name: "now", marker: {size: 6, color: ["#059669", "#2563eb", "#d97706"]}},
    {type: "mesh3d", x: [-0.6, 0.6, 0.6, -0.6], y: [-0.35, -0.35, 0.35, 0.35], z: [0.74, 0.74, 0.74, 0.74], i: [0, 0], j: [1, 2], k: [2, 3],
      color: "#d6c7a8", opacity: 0.5, hoverinfo: "skip"}];
  const sides = Object.fromEntries(["xaxis", "yaxis", "zaxis"].map(name => [name, {gridcolor: colour("--line")}]));
  Plotly.newPlot("space", traces, {...look(), margin: {l: 0, r: 0, t: 0, b: 0}, legend: {x: 0, y: 1}, scene: {...sides, aspectmode: "data",
    camera: {eye: {x: 0.1, y: -1.5, z: 1.1}}}}, {displayModeBar: false});
}

function timeline() {
  const box = at("timeline"), whole = data.frames / data.fps, left = t => `${100 * t / whole}%`;
  box.replaceChildren();
  for (const span of data.spans) {
    const made = add(box, "div", "", {className: "span", title: span.name});
    const row = Object.keys(COLOURS).indexOf(span.name);
    Object.assign(made.style, {left: left(span.start), width: left(span.end - span.start), top: `calc(var(--up) + ${10 * row}px)`, background: COLOURS[span.name]});
    made.textContent = span.name;
  }
  box.classList.toggle("scripted", data.skills.length > 0);
  for (const skill of data.skills) {
    const made = add(box, "div", skill.name, {className: `skill ${skill.arm} ${skill.half}`});
    made.title = `${skill.arm} arm: ${skill.said}, ${skill.start.toFixed(2)} to ${skill.end.toFixed(2)} s`;
    Object.assign(made.style, {left: left(skill.start), width: left(skill.end - skill.start)});
  }
  const ends = [];  // where the labels of each row end (px): one that does not fit goes to the next row
  for (const event of [...data.events].sort((a, b) => a.time - b.time)) {
    const made = add(box, "div", undefined, {className: "event", title: `${event.name} ${event.time.toFixed(3)} s ${event.by}`});
    made.style.left = left(event.time);
    const label = add(made, "span", event.name), x = event.time / whole * box.clientWidth, width = label.offsetWidth + 8;
    const late = x + width > box.clientWidth, from = late ? x - width : x;
    made.classList.toggle("late", late);
    let row = ends.findIndex(end => end <= from);
    if (row < 0) row = ends.length;
    ends[row] = from + width;
    label.style.top = `${11 * row}px`;
  }
  box.style.setProperty("--up", `${Math.max(24, 11 * ends.length + 2)}px`);
  add(box, "div", "", {className: "now", id: "now"});
  box.onclick = e => go(Math.floor((e.clientX - box.getBoundingClientRect().left) / box.clientWidth * data.frames));
}

function go(to) {
  frame = Math.max(0, Math.min(data.frames - 1, to));
  at("frame").value = frame;
  link();
  at("clock").textContent = `frame ${frame} of ${data.frames}, ${(frame / data.fps).toFixed(2)} s`;
  at("now").style.left = `${100 * frame / data.frames}%`;
  film.currentTime = (frame + 0.5) / data.fps;
  Plotly.relayout("curve", {shapes: [now()]});
  Plotly.relayout("speed", {shapes: [now()]});
  const points = [data.path.target, data.hands.left, data.hands.right];
  Plotly.restyle("space", {x: [points.map(p => p[0][frame])], y: [points.map(p => p[1][frame])], z: [points.map(p => p[2][frame])]}, [5]);
}

function draw(name, camera) {
  const pen = at(`canvas-${name}`).getContext("2d"), box = data.boxes[name], [, , width, height] = box;
  pen.drawImage(film, ...box, 0, 0, width, height);
  pen.lineWidth = 2;
  if (at("show-masks").checked && camera.outlines.length) {
    pen.strokeStyle = "#fde047";
    for (const line of camera.outlines[frame]) {
      pen.beginPath();
      line.forEach(([x, y]) => pen.lineTo(x, y));
      pen.closePath();
      pen.stroke();
    }
  }
  if (at("show-track").checked) {
    pen.strokeStyle = "#22d3ee";
    pen.beginPath();
    let drawing = false;
    for (const point of camera.track.slice(Math.max(0, frame - 30), frame + 1)) {
      if (!point) { drawing = false; continue; }
      drawing ? pen.lineTo(...point) : pen.moveTo(...point);
      drawing = true;
    }
    pen.stroke();
    const here = camera.track[frame];
    if (here) { pen.beginPath(); pen.arc(here[0], here[1], 5, 0, 7); pen.stroke(); }
  }
  const flow = data.boxes[`${name} flow`];
  if (at("show-flow").checked && flow) pen.drawImage(film, ...flow, width - 100, 0, 100, 100);
}

function stop() {
  clearInterval(timer);
  timer = null;
  at("play").textContent = "play";
  if (data) link();
}

function play() {
  if (timer) return stop();
  at("play").textContent = "stop";
  timer = setInterval(() => frame + 1 < data.frames ? go(frame + 1) : stop(), 1000 / data.fps);
}

at("play").onclick = play;
at("frame").oninput = () => go(Number(at("frame").value));
for (const id of ["show-track", "show-masks", "show-flow"]) at(id).onchange = () => go(frame);
document.onkeydown = e => {
  if (at("episode").hidden || ["SELECT", "INPUT"].includes(e.target.tagName) && e.target.type !== "range" && e.target.type !== "checkbox") return;
  const next = step => { const i = listed.indexOf(shown) + step; if (i >= 0 && i < listed.length) open_(listed[i]); };
  const keys = {ArrowRight: () => go(frame + (e.shiftKey ? 10 : 1)), ArrowLeft: () => go(frame - (e.shiftKey ? 10 : 1)), " ": play,
    Home: () => go(0), End: () => go(data.frames - 1), n: () => next(1), p: () => next(-1), Escape: wall};
  if (keys[e.key]) { e.preventDefault(); keys[e.key](); }
};
