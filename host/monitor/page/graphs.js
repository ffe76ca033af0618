// @ts-check
// Rates and latency over the last minutes.

import { theme } from "./colours.js";

/** What a sample holds after its time: name, unit, and from which value on it is a whole graph. */
const GRAPHS = /** @type {const} */ ([
  ["scans", "/s", 5, 1],
  ["mapping one", "ms", 5, 2],
  ["late", "ms", 50, 3],
  ["effective particles", "", 10, 4],
  ["memory", "MB", 50, 5],
]);

/** @param {number} value */
function short(value) {
  return value >= 100 ? value.toFixed(0) : value.toPrecision(2).replace(/\.0$/, "");
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {Float32Array[]} samples
 */
export function drawGraphs(canvas, samples) {
  const ratio = devicePixelRatio;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const drawn = [width, height, ratio, theme().ink, samples.length, samples[samples.length - 1]].join();
  if (canvas.dataset["drawn"] === drawn) return;
  canvas.dataset["drawn"] = drawn;
  if (canvas.width !== width * ratio || canvas.height !== height * ratio) {
    canvas.width = width * ratio;
    canvas.height = height * ratio;
  }
  const pen = canvas.getContext("2d");
  if (!pen || width === 0) return;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const shown = GRAPHS.filter(([, , , column]) => samples.some((sample) => sample[column] > 0));
  const each = Math.min(54, height / Math.max(shown.length, 1));
  shown.forEach(([name, unit, least, column], k) => drawOne(pen, samples, { name, unit, least, column }, {
    top: k * each, width, height: each }));
}

/**
 * @param {CanvasRenderingContext2D} pen
 * @param {Float32Array[]} samples
 * @param {{ name: string, unit: string, least: number, column: number }} graph
 * @param {{ top: number, width: number, height: number }} place
 */
function drawOne(pen, samples, { name, unit, least, column }, { top, width, height }) {
  const colours = theme();
  const most = Math.max(0, ...samples.map((sample) => sample[column]));
  const [head, foot] = [top + 17, top + height - 4];
  const x = (/** @type {number} */ k) => width - 1 - ((samples.length - 1 - k) * width) / Math.max(60, samples.length);
  const y = (/** @type {number} */ value) => foot - (value / Math.max(most, least)) * (foot - head);
  pen.strokeStyle = colours.faint;
  pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(0, foot + 0.5);
  pen.lineTo(width, foot + 0.5);
  pen.stroke();
  pen.strokeStyle = colours.robot;
  pen.lineWidth = 1.5;
  pen.beginPath();
  samples.forEach((sample, k) => pen.lineTo(x(k), y(sample[column])));
  pen.stroke();
  pen.font = "11px system-ui, sans-serif";
  pen.fillStyle = colours.ink;
  pen.textAlign = "left";
  pen.fillText(name, 0, top + 11);
  pen.textAlign = "right";
  const last = samples[samples.length - 1]?.[column] ?? 0;
  pen.fillText(`${short(last)} ${unit}  (most ${short(most)})`, width, top + 11);
}
