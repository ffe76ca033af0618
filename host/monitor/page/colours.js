// @ts-check
// Colours for light and dark. Told apart by those who see no red or no green: what differs in hue differs in brightness or shape, too.

/** @typedef {[number, number, number]} Rgb */
/**
 * @typedef {object} Theme
 * @property {Rgb[][]} cells by layer: unknown, free, occupied
 * @property {string} ground
 * @property {string} ink
 * @property {string} faint
 * @property {string} robot
 * @property {string} ghost
 * @property {string} closure
 * @property {string} particle
 * @property {string} doubt
 * @property {string[]} fits on a wall, near, new, against the map
 * @property {Rgb[]} time from the beginning to now
 */

/** @type {Theme} */
const LIGHT = {
  cells: [[[233, 231, 225], [255, 255, 255], [29, 36, 48]], [[233, 231, 225], [250, 240, 246], [160, 60, 120]]],
  ground: "#e9e7e1",
  ink: "#1d2430",
  faint: "rgba(29,36,48,0.16)",
  robot: "#0072b2",
  ghost: "#d55e00",
  closure: "#b35900",
  particle: "rgba(0,114,178,0.35)",
  doubt: "#b35900",
  fits: ["#00a878", "#3a9fd6", "#8a8f98", "#d55e00"],
  time: [[59, 15, 143], [181, 54, 122], [251, 135, 97]],
};

/** @type {Theme} */
const DARK = {
  cells: [[[17, 20, 25], [36, 41, 49], [226, 224, 216]], [[17, 20, 25], [48, 38, 46], [226, 140, 190]]],
  ground: "#111419",
  ink: "#e8e6df",
  faint: "rgba(232,230,223,0.16)",
  robot: "#56b4e9",
  ghost: "#e69f00",
  closure: "#e69f00",
  particle: "rgba(86,180,233,0.4)",
  doubt: "#e69f00",
  fits: ["#2fd0a0", "#7cc7f2", "#8a919c", "#ff7a33"],
  time: [[125, 110, 255], [224, 86, 155], [255, 196, 107]],
};

const dark = matchMedia("(prefers-color-scheme: dark)");
/** @type {string | null} */
let chosen = null;

/** @returns {Theme} */
export function theme() {
  return (chosen ?? (dark.matches ? "dark" : "light")) === "dark" ? DARK : LIGHT;
}

/** @param {() => void} changed is called when the colours have changed */
export function onTheme(changed) {
  dark.addEventListener("change", changed);
}

/** Light becomes dark, and dark light. */
export function turnTheme() {
  chosen = theme() === DARK ? "light" : "dark";
  document.documentElement.dataset["theme"] = chosen;
}

/**
 * @param {number} share of the time from the beginning (0) to now (1)
 * @returns {string}
 */
export function timeColour(share) {
  const stops = theme().time;
  const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const k = Math.min(Math.floor(at), stops.length - 2);
  const mix = (/** @type {0 | 1 | 2} */ c) => Math.round(stops[k][c] + (at - k) * (stops[k + 1][c] - stops[k][c]));
  return `rgb(${mix(0)},${mix(1)},${mix(2)})`;
}
