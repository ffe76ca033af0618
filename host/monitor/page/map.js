// @ts-check
// The map's tiles, painted on sheets of several sizes: at every zoom few and small pictures are drawn, however large the map is.

import { theme } from "./colours.js";

const TILE = 64; // cells
const SHEET = 512; // pixels
const LEVELS = 7; // at the last one a tile is a pixel
const STEP = 16; // cells in which the extent grows
const GHOST_MS = 2600;
const GHOSTS_MAX = 600;

/** @typedef {{ column: number, row: number, picture: HTMLCanvasElement, since: number }} Ghost */

/**
 * Runs of cells, as they are sent, to one byte a cell: 0 unknown, 1 free, 2 occupied.
 * @param {Uint8Array} runs
 * @returns {Uint8Array}
 */
export function unpack(runs) {
  const cells = new Uint8Array(TILE * TILE);
  let at = 0;
  for (const run of runs) {
    const end = at + (run & 63) + 1;
    cells.fill(run >> 6, at, end);
    at = end;
  }
  return cells;
}

/**
 * Half as many cells to a side; the strongest of four stays.
 * @param {Uint8Array} cells
 * @param {number} side
 * @returns {Uint8Array}
 */
function halved(cells, side) {
  const half = side / 2;
  const out = new Uint8Array(half * half);
  for (let row = 0; row < half; row++) {
    for (let column = 0; column < half; column++) {
      const k = 2 * row * side + 2 * column;
      out[row * half + column] = Math.max(cells[k], cells[k + 1], cells[k + side], cells[k + side + 1]);
    }
  }
  return out;
}

/**
 * @param {Uint8Array} cells
 * @returns {[number, number, number, number] | null} columns and rows of a tile from which and up to which something is known
 */
function known(cells) {
  let [left, bottom, right, top] = [TILE, TILE, 0, 0];
  for (let k = 0; k < cells.length; k++) {
    if (cells[k] === 0) continue;
    const [column, row] = [k % TILE, (k / TILE) | 0];
    [left, right] = [Math.min(left, column), Math.max(right, column + 1)];
    [bottom, top] = [Math.min(bottom, row), Math.max(top, row + 1)];
  }
  return left < right ? [left, bottom, right, top] : null;
}

/**
 * @param {number} width
 * @param {number} height
 */
function canvas(width, height) {
  const made = document.createElement("canvas");
  made.width = width;
  made.height = height;
  return made;
}

export class TileMap {
  constructor() {
    this.cellSize = 0.05;
    /** @type {Map<string, { layer: number, column: number, row: number, cells: Uint8Array, known: [number, number, number, number] | null }>} */
    this.tiles = new Map();
    /** @type {Map<string, HTMLCanvasElement>[]} by layer and level */
    this.sheets = [];
    /** @type {Ghost[]} where walls were before they moved */
    this.ghosts = [];
    this.clear();
  }

  clear() {
    this.tiles.clear();
    this.ghosts = [];
    this.sheets = Array.from({ length: 2 * LEVELS }, () => new Map());
  }

  repaint() {
    this.sheets = Array.from({ length: 2 * LEVELS }, () => new Map());
    for (const tile of this.tiles.values()) this.#paint(tile);
  }

  /**
   * @param {number} layer
   * @param {number} column
   * @param {number} row
   * @param {Uint8Array} runs
   * @param {boolean} leavesGhost walls that go are seen for a moment
   */
  put(layer, column, row, runs, leavesGhost) {
    const key = `${layer},${column},${row}`;
    const cells = unpack(runs);
    const tile = { layer, column, row, cells, known: known(cells) };
    const before = this.tiles.get(key);
    if (leavesGhost && before && layer === 0) this.#leave(before.cells, tile);
    this.tiles.set(key, tile);
    this.#paint(tile);
  }

  /**
   * @param {Uint8Array} before
   * @param {{ column: number, row: number, cells: Uint8Array }} tile
   */
  #leave(before, { column, row, cells }) {
    if (this.ghosts.length >= GHOSTS_MAX) return;
    const picture = canvas(TILE, TILE);
    const pen = picture.getContext("2d");
    if (!pen) return;
    pen.fillStyle = theme().ghost;
    let gone = 0;
    for (let k = 0; k < before.length; k++) {
      if (before[k] !== 2 || cells[k] === 2) continue;
      pen.fillRect(k % TILE, TILE - 1 - Math.floor(k / TILE), 1, 1);
      gone++;
    }
    if (gone > 0) this.ghosts.push({ column, row, picture, since: performance.now() });
  }

  /** @param {{ layer: number, column: number, row: number, cells: Uint8Array }} tile */
  #paint({ layer, column, row, cells }) {
    const colours = theme().cells[layer];
    for (let level = 0, side = TILE; level < LEVELS; level++, side /= 2) {
      if (level > 0) cells = halved(cells, side * 2);
      const across = SHEET / side;
      const [c, r] = [Math.floor(column / across), Math.floor(row / across)];
      const picture = new ImageData(side, side);
      for (let k = 0; k < cells.length; k++) {
        const at = 4 * ((side - 1 - Math.floor(k / side)) * side + (k % side));
        const [red, green, blue] = colours[cells[k]];
        picture.data[at] = red;
        picture.data[at + 1] = green;
        picture.data[at + 2] = blue;
        picture.data[at + 3] = cells[k] === 0 ? 0 : 255;
      }
      const pen = this.#sheet(layer, level, c, r).getContext("2d");
      pen?.putImageData(picture, (column - c * across) * side, SHEET - (row - r * across + 1) * side);
    }
  }

  /**
   * @param {number} layer
   * @param {number} level
   * @param {number} column
   * @param {number} row
   */
  #sheet(layer, level, column, row) {
    const sheets = this.sheets[layer * LEVELS + level];
    const key = `${column},${row}`;
    let sheet = sheets.get(key);
    if (!sheet) {
      sheet = canvas(SHEET, SHEET);
      sheets.set(key, sheet);
    }
    return sheet;
  }

  /** @returns {[number, number, number, number] | null} what is known lies in it: left, bottom, right, top, m */
  extent() {
    let [left, bottom, right, top] = [Infinity, Infinity, -Infinity, -Infinity];
    for (const { column, row, known } of this.tiles.values()) {
      if (!known) continue;
      [left, right] = [Math.min(left, column * TILE + known[0]), Math.max(right, column * TILE + known[2])];
      [bottom, top] = [Math.min(bottom, row * TILE + known[1]), Math.max(top, row * TILE + known[3])];
    }
    // In steps, so that the picture does not breathe with every scan.
    const [down, up] = [Math.floor, Math.ceil].map((round) => (/** @type {number} */ at) => round(at / STEP) * STEP * this.cellSize);
    return left < right ? [down(left), down(bottom), up(right), up(top)] : null;
  }

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {import("./view.js").Camera} camera
   * @param {number} alpha of the map itself
   */
  draw(pen, camera, alpha) {
    const perCell = camera.scale * this.cellSize;
    const level = Math.min(LEVELS - 1, Math.max(0, Math.ceil(-Math.log2(perCell))));
    pen.imageSmoothingEnabled = false;
    for (const layer of [0, 1]) {
      pen.globalAlpha = layer === 0 ? alpha : 1;
      const side = SHEET * 2 ** level * this.cellSize;
      for (const [key, sheet] of this.sheets[layer * LEVELS + level]) {
        const [column, row] = key.split(",").map(Number);
        camera.picture(pen, sheet, column * side, (row + 1) * side, side);
      }
    }
    pen.globalAlpha = 1;
  }

  /**
   * Where walls were before a loop was closed.
   * @param {CanvasRenderingContext2D} pen
   * @param {import("./view.js").Camera} camera
   * @returns {boolean} there are some still
   */
  drawGhosts(pen, camera) {
    const now = performance.now();
    this.ghosts = this.ghosts.filter((ghost) => now - ghost.since < GHOST_MS);
    const side = TILE * this.cellSize;
    for (const { column, row, picture, since } of this.ghosts) {
      pen.globalAlpha = 0.9 * (1 - (now - since) / GHOST_MS);
      camera.picture(pen, picture, column * side, (row + 1) * side, side);
    }
    pen.globalAlpha = 1;
    return this.ghosts.length > 0;
  }
}
