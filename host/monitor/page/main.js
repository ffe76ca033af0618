// @ts-check
// The page put together: robots, views, words, numbers, buttons and keys.

import { onTheme, turnTheme } from "./colours.js";
import { drawGraphs } from "./graphs.js";
import { Robot, credentials, token } from "./state.js";
import { View } from "./view.js";

const NOTE_MS = 2500;
/** How often it is asked whether more robots have come. */
const GROWS_EVERY_MS = 2000;

/** @param {string} id @returns {HTMLElement} */
function element(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(id);
  return found;
}

const place = element("views");
/** @type {Robot[]} */
let robots = [];
/** @type {View[]} */
let views = [];
/** Index of the robot that words and numbers are about. */
let chosen = 0;
let mayCommand = false;
/** More robots may come. */
let mayGrow = false;
let isOne = false;

/** @param {string} text */
function note(text) {
  const output = element("note");
  output.textContent = text;
  output.classList.add("shown");
  setTimeout(() => output.classList.remove("shown"), NOTE_MS);
}

/** @param {View} view */
function show(view) {
  const figure = document.createElement("figure");
  figure.append(view.canvas);
  if (robots.length > 1) figure.append(document.createElement("figcaption"));
  place.append(figure);
}

/** @param {Robot[]} shown */
function makeView(shown) {
  const canvas = document.createElement("canvas");
  canvas.tabIndex = 0;
  canvas.setAttribute("aria-label", `Map of ${shown.map((robot) => robot.name).join(", ")}`);
  const view = new View(canvas, shown);
  view.fit();
  canvas.addEventListener("pointerdown", ({ offsetX, offsetY }) => {
    chosen = robots.indexOf(view.nearest(offsetX * devicePixelRatio, offsetY * devicePixelRatio));
    refresh();
  });
  return view;
}

/** Robots whose maps have the same frame lie on one map if that is wanted, the others side by side. */
function arrange() {
  /** @type {Robot[][]} */
  const groups = [];
  for (const robot of robots) {
    const frame = robot.status?.frame;
    const group = isOne && frame ? groups.find((others) => others[0].status?.frame === frame) : undefined;
    if (group) group.push(robot);
    else groups.push([robot]);
  }
  place.replaceChildren();
  place.classList.toggle("many", groups.length > 1);
  views = groups.map(makeView);
  views.forEach(show);
  refresh();
}

function view() {
  return views.find((one) => one.robots.includes(robots[chosen])) ?? views[0];
}

/** @param {number} value @param {number} digits @param {string} unit */
function number(value, digits, unit) {
  return `${value.toFixed(digits)}\u202f${unit}`;
}

/** @param {Robot} robot @returns {[string, string][]} */
function numbers({ status }) {
  if (!status) return [];
  const { pose, covariance, rates, health } = status;
  /** @type {[string, string][]} */
  const rows = [];
  if (pose) {
    rows.push(["position", `${pose[0].toFixed(2)}, ${number(pose[1], 2, "m")}`]);
    const sigma = 100 * Math.sqrt(Math.max(covariance[0] + covariance[2], 0));
    rows.push(["heading", number((pose[2] * 180) / Math.PI, 1, "°")], ["give or take", number(10 * sigma, sigma < 1 ? 1 : 0, "mm")]);
  }
  if (status.certainty !== null) rows.push(["sure", number(100 * status.certainty, 0, "%")]);
  rows.push(["way", number(status.way_m, 1, "m")], ["scans", `${status.scans}`], ["of them lost", `${status.lost_scans}`]);
  rows.push(["loops closed", `${status.closures}`]);
  if (status.pieces_apart > 0) rows.push(["pieces apart", `${status.pieces_apart}`]);
  if (rates) rows.push(["memory", number(rates["memory_mb"], 0, "MB")]);
  if (health) rows.push(["damaged", `${health[0]}`], ["laser restarts", `${health[1]}`], ["scans missed", `${health[2]}`]);
  return rows;
}

/** @param {Robot} robot @returns {[string, string, string]} mood, words, and more of them */
function words({ link, status }) {
  if (link === "refused") return ["bad", "not allowed: open the link that the program has printed", ""];
  if (link === "away" && status?.ended) return ["good", status.ended, "the program has ended"];
  if (link === "away") return ["bad", "no connection to the program", "trying again"];
  if (!status) return ["doubt", "connecting", ""];
  const source = status.source.split("/").pop();
  return [status.mood, status.words[0] ?? "", [...status.words.slice(1), `${status.what} ${source}`].join(" · ")];
}

/** @param {string} id @param {boolean} isPressed */
function press(id, isPressed) {
  element(id).setAttribute("aria-pressed", String(isPressed));
}

/** What lies over the only map is left free; several lie beside it. */
function leaveMargins() {
  const [head, panel, tools] = ["status", "panel", "tools"].map((id) => element(id).getBoundingClientRect());
  const isAside = panel.width > 0 && panel.left > innerWidth / 2;
  const bottom = innerHeight - (panel.width > 0 && !isAside ? panel.top : tools.top);
  const over = [8, bottom, isAside ? innerWidth - panel.left : 8, head.bottom + 8];
  const isOnly = views.length === 1;
  place.style.inset = isOnly ? "0" : `${over[3]}px ${over[2] + (isAside ? 8 : 0)}px ${over[1] + 8}px 8px`;
  const margins = isOnly ? over : [8, 44, 8, 44];
  for (const one of views) {
    if (String(one.margins) !== String(margins)) one.draw();
    one.margins = margins;
    const caption = one.canvas.nextElementSibling;
    if (!caption) continue;
    caption.textContent = one.robots.map((robot) => `${robot.name}: ${words(robot)[1]}`).join("\n");
    caption.parentElement?.classList.toggle("chosen", !isOnly && one.robots.includes(robots[chosen]));
  }
}

/** Two robots at least drive in the same frame. */
function canJoin() {
  const frames = robots.map((robot) => robot.status?.frame).filter(Boolean);
  return new Set(frames).size < frames.length;
}

/** Words and numbers as they are now. */
function refresh() {
  const robot = robots[chosen];
  if (!robot) return;
  const [mood, first, more] = words(robot);
  element("mood").className = mood;
  const text = element("words");
  if (text.dataset["said"] !== first + more) {
    text.dataset["said"] = first + more;
    text.replaceChildren(first, Object.assign(document.createElement("small"), { textContent: more }));
  }
  const status = robot.status;
  const name = robots.length > 1 ? `${robots.length} robots` : (status?.source ?? "");
  document.title = `${mood === "good" ? "" : "⚠ "}lrfslam ${name}`;
  element("cloud").hidden = robot.cloud.length === 0;
  element("one").hidden = !canJoin();
  for (const id of ["save", "pause", "stop"]) {
    const is = /** @type {HTMLButtonElement} */ (element(id));
    is.disabled = !mayCommand || robot.link !== "there" || Boolean(status?.ended && id !== "stop");
    is.hidden = id === "pause" && !status?.can_pause;
  }
  leaveMargins();
  press("follow", view()?.follows ?? false);
  press("fit", view()?.fits ?? false);
  press("cloud", view()?.is3d ?? false);
  press("measure", view()?.measures ?? false);
  press("pause", status?.is_paused ?? false);
  press("one", isOne);
  if (!element("panel").classList.contains("shown")) return;
  const [cells, list] = [numbers(robot).flat(), element("numbers")];
  while (list.children.length > cells.length) list.lastElementChild?.remove();
  cells.forEach((text, k) => {
    const cell = list.children[k] ?? list.appendChild(document.createElement(k % 2 ? "dd" : "dt"));
    if (cell.textContent !== text) cell.textContent = text;
  });
  drawGraphs(/** @type {HTMLCanvasElement} */ (element("graphs")), robot.samples);
}

let isDue = false;
/** Words, numbers and maps change in the same frame. */
function changed() {
  views.forEach((one) => one.draw());
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(() => {
    isDue = false;
    refresh();
  });
}

/** @param {string} command @param {string} said */
async function command(command, said) {
  note((await robots[chosen].ask(command)) ? said : "the program refuses: is this the link that it has printed?");
}

/** @type {Record<string, () => void>} what the buttons do */
const DEEDS = {
  follow: () => view().follow(),
  fit: () => view().fit(),
  in: () => view().zoomBy(1.4),
  out: () => view().zoomBy(1 / 1.4),
  measure: () => {
    for (const one of views) [one.measures, one.measured] = [!one.measures, []];
    place.classList.toggle("measuring", view().measures);
    if (view().measures) note("tap two points");
    changed();
  },
  cloud: () => {
    if (robots[chosen].cloud.length > 0 || view().is3d) view().is3d = !view().is3d;
    changed();
  },
  one: () => {
    isOne = !isOne && canJoin();
    arrange();
  },
  details: () => press("details", element("panel").classList.toggle("shown")),
  light: () => {
    turnTheme();
    repaint();
  },
  save: () => void command("save", "saving"),
  pause: () => {
    const isPaused = robots[chosen].status?.is_paused;
    void command(isPaused ? "resume" : "pause", isPaused ? "going on" : "paused");
  },
  stop: () => /** @type {HTMLDialogElement} */ (element("ask")).showModal(),
};

/** @type {Record<string, string | (() => void)>} what the keys do */
const KEYS = {
  f: "follow", 0: "fit", "+": "in", "=": "in", "-": "out", m: "measure", c: "cloud", t: "one", g: "details", l: "light",
  s: "save", " ": "pause",
  ArrowLeft: () => view().pan(60, 0), ArrowRight: () => view().pan(-60, 0),
  ArrowUp: () => view().pan(0, 60), ArrowDown: () => view().pan(0, -60),
};

function repaint() {
  robots.forEach((robot) => robot.map.repaint());
  changed();
}

/** Asks who is there, and what this page may do. */
async function introduce() {
  const answer = await fetch("robots", { headers: credentials() });
  if (!answer.ok) return answer.status;
  const { robots: names, may_grow, may_command } = await answer.json();
  mayCommand = may_command;
  mayGrow = may_grow;
  return /** @type {string[]} */ (names);
}

async function begin() {
  const names = await introduce().catch(() => 0);
  if (!Array.isArray(names) && robots.length > 0) {
    setTimeout(() => void begin(), GROWS_EVERY_MS);
    return;
  }
  if (!Array.isArray(names)) {
    element("mood").className = "bad";
    element("words").textContent =
      names === 401 ? "not allowed: open the link that the program has printed" : "no connection to the program";
    setTimeout(() => void begin(), 1500);
    return;
  }
  const come = names.slice(robots.length).map((name, index) => new Robot(robots.length + index, name));
  if (come.length > 0) {
    robots = [...robots, ...come];
    arrange();
    for (const robot of come) void robot.follow(changed, () => void introduce().catch(() => 0));
  } else if (robots.length === 0) {
    element("mood").className = "doubt";
    element("words").textContent = "no robot is there yet";
  }
  if (mayGrow) setTimeout(() => void begin(), GROWS_EVERY_MS);
}

for (const [id, deed] of Object.entries(DEEDS)) {
  element(id).addEventListener("click", () => {
    deed();
    refresh();
  });
}
addEventListener("resize", refresh);
addEventListener("keydown", (event) => {
  const deed = KEYS[event.key];
  if (event.ctrlKey || event.metaKey || event.altKey || !deed || !views[0]) return;
  if (event.key === " " && event.target instanceof HTMLButtonElement) return;
  event.preventDefault();
  if (typeof deed === "string") element(deed).click();
  else deed();
  refresh();
});
element("ask").addEventListener("close", () => {
  if (/** @type {HTMLDialogElement} */ (element("ask")).returnValue === "stop") void command("stop", "ending");
});
onTheme(repaint);
if (innerWidth > 900) DEEDS["details"]();
// For those who test the page.
Object.assign(globalThis, { lrfslam: { robots: () => robots, views: () => views, token } });
void begin();
