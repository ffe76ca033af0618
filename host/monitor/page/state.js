// @ts-check
// A robot's state as the page knows it: what has changed is fetched, and taken in. The form is that of `lrfslam_host::monitor::wire`.

import { TileMap } from "./map.js";

const HEAD = 28;
const RETRY_MS = [300, 1000];
const SAMPLES_MAX = 600;

/**
 * @typedef {object} Status
 * @property {string} what
 * @property {string} source
 * @property {string | null} frame
 * @property {string[]} words
 * @property {"good" | "doubt" | "bad"} mood
 * @property {[number, number, number] | null} pose
 * @property {[number, number, number, number]} covariance
 * @property {[number, number] | null} undetermined
 * @property {number | null} certainty
 * @property {boolean} is_apart
 * @property {number} time_s
 * @property {number} scans
 * @property {number} lost_scans
 * @property {number} closures
 * @property {number} pieces_apart
 * @property {number} way_m
 * @property {Record<string, number> | null} rates
 * @property {[number, number, number] | null} health
 * @property {boolean} can_pause
 * @property {boolean} is_paused
 * @property {string | null} ended
 * @property {number} snaps
 */

/** The part of the address after `#`, which is sent to nobody but our own server. */
export const token = location.hash.slice(1);

/** @returns {HeadersInit} */
export function credentials() {
  return token ? { authorization: `Bearer ${token}` } : {};
}

export class Robot {
  /** @type {Status | null} */
  status = null;
  /** @type {Float32Array} x, y, time, trusted; as long as `pathLength` says. */
  path = new Float32Array(0);
  pathLength = 0;
  /** @type {Float32Array} */
  closures = new Float32Array(0);
  /** @type {Float32Array} */
  scan = new Float32Array(0);
  /** @type {Float32Array} */
  particles = new Float32Array(0);
  /** @type {Float32Array} x, y, and covariance: xx, xy, yy */
  landmarks = new Float32Array(0);
  /** @type {Float32Array} */
  cloud = new Float32Array(0);
  /** @type {Float32Array[]} */
  samples = [];
  /** @type {{ ends: Float32Array, since: number } | null} the newest closure */
  closed = null;
  snaps = false;
  map = new TileMap();
  instance = 0n;
  revision = 0n;
  /** @type {"waiting" | "there" | "away" | "refused"} */
  link = "waiting";
  /** Bytes received, and messages. */
  received = [0, 0];

  /**
   * @param {number} index
   * @param {string} name
   */
  constructor(index, name) {
    this.index = index;
    this.name = name;
  }

  clear() {
    this.map.clear();
    [this.status, this.closed, this.pathLength, this.samples] = [null, null, 0, []];
    this.closures = this.scan = this.particles = this.landmarks = this.cloud = new Float32Array(0);
  }

  /**
   * Fetches changes for ever.
   * @param {() => void} changed
   * @param {() => void} returned the server is there, perhaps another one
   */
  async follow(changed, returned) {
    for (let failures = 0; ; ) {
      try {
        const url = `robots/${this.index}/changes?${this.instance}-${this.revision}`;
        const answer = await fetch(url, { headers: credentials() });
        if (!answer.ok) throw answer.status;
        this.take(await answer.arrayBuffer());
        if (this.link !== "there") returned();
        this.link = "there";
        failures = 0;
        changed();
        // A page that is not seen asks for nothing, and one that is, for no more than it can draw.
        await new Promise((done) => requestAnimationFrame(done));
      } catch (error) {
        this.link = error === 401 ? "refused" : "away";
        changed();
        await new Promise((done) => setTimeout(done, RETRY_MS[Math.min(failures++, RETRY_MS.length - 1)]));
      }
    }
  }

  /** @param {ArrayBuffer} message */
  take(message) {
    const view = new DataView(message);
    if (message.byteLength < HEAD || view.getUint32(0) !== 0x4c52464d || view.getUint32(4, true) !== 1) {
      throw new Error("not a message of this version");
    }
    this.received = [this.received[0] + message.byteLength, this.received[1] + 1];
    const isAll = view.getUint32(24, true) === 1;
    if (isAll) this.clear();
    this.instance = view.getBigUint64(8, true);
    this.revision = view.getBigUint64(16, true);
    for (let at = HEAD; at + 8 <= message.byteLength; ) {
      const [kind, length] = [view.getUint32(at, true), view.getUint32(at + 4, true)];
      this.#section(kind, new DataView(message, at + 8, length), isAll);
      at = (at + 8 + length + 3) & ~3;
    }
  }

  /**
   * @param {number} kind
   * @param {DataView} part
   * @param {boolean} isAll
   */
  #section(kind, part, isAll) {
    const floats = (from = 0) => new Float32Array(part.buffer, part.byteOffset + from, (part.byteLength - from) / 4);
    if (kind === 1) this.#status(JSON.parse(new TextDecoder().decode(part)), isAll);
    else if (kind === 2) this.#tiles(part);
    else if (kind === 3) this.#extendPath(part.getUint32(0, true), floats(4));
    else if (kind === 4) this.#closures(floats(), isAll);
    else if (kind === 5) this.scan = floats();
    else if (kind === 6) this.particles = floats();
    else if (kind === 7) this.#extendCloud(part.getUint32(0, true), floats(4));
    else if (kind === 8) this.#samples(floats());
    else if (kind === 9) this.landmarks = floats();
  }

  /**
   * @param {Status} status
   * @param {boolean} isAll
   */
  #status(status, isAll) {
    this.snaps = !isAll && this.status !== null && status.snaps > this.status.snaps;
    this.status = status;
  }

  /** @returns {[number, number, number, number] | null} what is known lies in it: left, bottom, right, top, m */
  extent() {
    const extent = this.map.extent();
    if (this.landmarks.length === 0) return extent;
    let [left, bottom, right, top] = extent ?? [Infinity, Infinity, -Infinity, -Infinity];
    /** @param {Float32Array} points @param {number} length @param {number} step */
    const take = (points, length, step) => {
      for (let k = 0; k < length; k += step) {
        [left, right] = [Math.min(left, points[k]), Math.max(right, points[k])];
        [bottom, top] = [Math.min(bottom, points[k + 1]), Math.max(top, points[k + 1])];
      }
    };
    take(this.landmarks, this.landmarks.length, 5);
    take(this.path, 4 * this.pathLength, 4);
    // In steps, so that the picture does not breathe.
    return [Math.floor(left - 0.5), Math.floor(bottom - 0.5), Math.ceil(right + 0.5), Math.ceil(top + 0.5)];
  }

  /** @param {DataView} part */
  #tiles(part) {
    this.map.cellSize = Math.fround(part.getFloat32(0, true));
    const count = part.getUint32(8, true);
    for (let k = 0, at = 12; k < count; k++) {
      const length = part.getInt32(at + 12, true);
      const runs = new Uint8Array(part.buffer, part.byteOffset + at + 16, length);
      this.map.put(
        part.getInt32(at, true), part.getInt32(at + 4, true), part.getInt32(at + 8, true), runs, this.snaps);
      at += 16 + ((length + 3) & ~3);
    }
  }

  /**
   * @param {number} first
   * @param {Float32Array} points
   */
  #extendPath(first, points) {
    const length = 4 * first + points.length;
    if (length > this.path.length) {
      const larger = new Float32Array(2 * length);
      larger.set(this.path.subarray(0, 4 * first));
      this.path = larger;
    }
    this.path.set(points, 4 * first);
    this.pathLength = length / 4;
  }

  /**
   * @param {Float32Array} ends
   * @param {boolean} isAll
   */
  #closures(ends, isAll) {
    if (!isAll && ends.length > this.closures.length) {
      this.closed = { ends: ends.slice(-4), since: performance.now() };
    }
    this.closures = ends;
  }

  /**
   * @param {number} first
   * @param {Float32Array} points
   */
  #extendCloud(first, points) {
    const cloud = new Float32Array(3 * first + points.length);
    cloud.set(this.cloud.subarray(0, 3 * first));
    cloud.set(points, 3 * first);
    this.cloud = cloud;
  }

  /** @param {Float32Array} values */
  #samples(values) {
    for (let k = 0; k + 6 <= values.length; k += 6) this.samples.push(values.slice(k, k + 6));
    this.samples.splice(0, this.samples.length - SAMPLES_MAX);
  }

  /**
   * @param {string} command
   * @returns {Promise<boolean>} it was taken
   */
  async ask(command) {
    try {
      const answer = await fetch(`robots/${this.index}/${command}`, { method: "POST", headers: credentials() });
      return answer.ok;
    } catch {
      return false;
    }
  }
}
