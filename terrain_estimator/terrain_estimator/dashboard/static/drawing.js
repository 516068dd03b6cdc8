// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
// Content of each chart: its data, a sentence for screen readers, and the table of its numbers.

import { areaChart, bandChart, fitPlane, placeChart, readColours, timelineChart, wheelChart, wheelLines } from "/charts.js";
import { clock, fixed, make, number, plain, show } from "/words.js";

const LISTED = 20; // rows of a table of numbers
const CALM_S = 2;
const LANES = ["Estimate", "Observations", "Health"];
const STATUS_LOOKS = { PRIOR_ONLY: "idle", CONVERGING: "some", IDENTIFIED: "good", STANDING_STILL: "idle", DEGRADED: "warn", DISAGREES: "bad" };
const OUTCOME_LOOKS = { ACCEPTED: "good", ACCEPTED_PARTIALLY: "some", STANDSTILL: "idle" };
const HEALTH_LOOKS = { OK: "good", WARN: "warn", ERROR: "bad", STALE: "bad" };
const BANDS = ["_lower_95", "_upper_95", "_lower_68", "_upper_68", ""];
const charts = {};
let drawn = "";

export function makeCharts(store, view) {
  readColours();
  charts.cohesion = bandChart("cohesion", view);
  charts.tan_phi = bandChart("tan_phi", view);
  charts.slip = wheelChart("slip", view);
  charts.sinkage = wheelChart("sinkage", view);
  charts.change = areaChart("change", view, "probability [%]");
  charts.timeline = timelineChart("timeline", view, LANES);
  charts.track = placeChart("track", view, ["x [m]", "y [m]"], 0);
  charts.height = placeChart("height", view, ["distance [m]", "z [m]"], "20%");
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) charts[entry.target.id].seen = entry.isIntersecting;
    drawn = ""; // a chart that comes into sight is drawn even where no data arrives any more
  }, { rootMargin: "200px" });
  for (const name of Object.keys(charts)) {
    const figure = document.getElementById(name);
    seen.observe(figure);
    figure.querySelector("details").addEventListener("toggle", () => drawCharts(store, view, true));
  }
}

/** Restyle the charts after a change between light and dark. */
export function restyle() {
  readColours();
  for (const chart of Object.values(charts)) {
    for (const axis of Object.values(chart.options.scales)) Object.assign(axis, { ticks: { ...axis.ticks, color: Chart.defaults.color } });
  }
}

/** Draw the charts in sight, unless nothing has changed since the last time. */
export function drawCharts(store, view, always) {
  const state = `${store.time}/${store.recent.length}/${Object.keys(store.ages).filter((topic) => store.isStale(topic))}`;
  if (state === drawn && !always) return;
  drawn = state;
  const drive = store.drive, rows = view.whole ? drive : store.recent;
  const span = view.whole ? [0, Math.max(store.end, 1)] : [store.end - store.begin.window, store.end];
  for (const [name, chart] of Object.entries(charts)) {
    if (!chart.seen && !always) continue;
    const table = DRAW[name](chart, store, name === "track" || name === "height" ? drive : rows, span);
    chart.canvas.setAttribute("aria-label", table.words);
    chart.update("none");
    if (document.querySelector(`#${name} details`).open) fill(document.querySelector(`#${name} table`), store, table);
  }
}

/** The word before a value: the last one may be old. */
const when = (store, topic) => (store.isStale(topic) ? "last" : "now");

const DRAW = {
  cohesion: (...given) => band("cohesion", "Cohesion c", "kPa", 1e-3, ...given),
  tan_phi: (...given) => band("tan_phi", "Friction, as tan φ", "1", 1, ...given),
  slip: (...given) => wheels("slip", "Slip", "1", 1, ...given),
  sinkage: (...given) => wheels("sinkage", "Sinkage", "mm", 1000, ...given),
  change(chart, store, rows, span) {
    chart.data.datasets[0].data = store.points(rows, "change_probability", 100);
    fitTime(chart, span);
    const now = store.at("terrain_estimate/change_probability");
    return { words: `Probability that the ground changed: ${when(store, "terrain_estimate")} ${number(now === null ? null : 100 * now)} percent`, rows, columns: [["probability [%]", "change_probability", 100]] };
  },
  timeline(chart, store, rows, span) {
    const names = store.begin;
    const lanes = [["status", names.statuses, STATUS_LOOKS], ["outcome", names.outcomes, OUTCOME_LOOKS], ["health", names.levels, HEALTH_LOOKS]];
    chart.data.datasets[0].data = lanes.flatMap(([column, states, looks], k) => runs(store.points(rows, column), span[1]).map(
      ({ from, to, value }) => ({ x: [from, to], y: LANES[k], state: plain(states[value]), look: looks[states[value]] ?? "bad" }),
    ));
    fitTime(chart, span);
    const last = LANES.map((lane) => `${lane} ${chart.data.datasets[0].data.filter((item) => item.y === lane).pop()?.state ?? "not known"}`);
    return { words: `Timeline: ${when(store, "terrain_estimate")} ${last.join(", ")}`, rows, columns: lanes.map(([column, states], k) => [LANES[k], column, (value) => plain(states[value])]) };
  },
  track(chart, store, rows) {
    const [x, y] = ["x", "y"].map((axis) => store.points(rows, axis));
    const line = x.map((point, k) => ({ x: point.y, y: y[k].y })), odometry = store.now.odom;
    chart.data.datasets[1].data = line;
    chart.data.datasets[0].data = odometry ? [{ x: odometry.x, y: odometry.y }] : [];
    chart.data.datasets[0].rotation = 90 - (180 / Math.PI) * (odometry?.heading ?? 0);
    fitPlane(chart, odometry ? [...line, odometry] : line);
    const words = odometry ? `${when(store, "odom")} at x ${number(odometry.x)}, y ${number(odometry.y)} metres` : "no odometry";
    return { words: `Track from above: ${words}`, rows, columns: [["x [m]", "x", 1], ["y [m]", "y", 1], ["speed [m/s]", "velocity", 1]] };
  },
  height(chart, store, rows) {
    const [x, y, z] = ["x", "y", "z"].map((axis) => store.points(rows, axis));
    let way = 0, last = null;
    chart.data.datasets[1].data = z.map((point, k) => {
      const place = x[k].y === null ? last : [x[k].y, y[k].y];
      if (place && last) way += Math.hypot(place[0] - last[0], place[1] - last[1]);
      last = place;
      return { x: way, y: point.y };
    });
    const end = store.now.odom?.z ?? null;
    chart.data.datasets[0].data = end === null ? [] : [{ x: way, y: end }];
    chart.data.datasets[0].rotation = 90;
    chart.options.scales.x.min = 0;
    return { words: `Height along the way: ${when(store, "odom")} ${number(end)} metres after ${number(way)} metres`, rows, columns: [["z [m]", "z", 1]] };
  },
};

function band(name, title, unit, scale, chart, store, rows, span) {
  const [low95, high95, low68, high68, mean] = BANDS.map((bound) => store.points(rows, `${name}${bound}`, scale));
  [low95, high95, low68, high68, mean].forEach((data, k) => { chart.data.datasets[k].data = data; });
  const truth = store.points(rows, `truth_${name}`, scale);
  chart.data.datasets[5].data = truth;
  const known = truth.some((point) => point.y !== null);
  document.querySelector(".truth-key").hidden = !known;
  fitTime(chart, span);
  Object.assign(chart.options.scales.y, range(low95, high95, known ? truth : mean));
  const [now, low, high] = ["", "_lower_95", "_upper_95"].map((part) => store.at(`terrain_estimate/${name}${part}`));
  const scaled = (value) => number(value === null ? null : scale * value);
  return {
    words: `${title}: ${when(store, "terrain_estimate")} ${scaled(now)}, 95 percent between ${scaled(low)} and ${scaled(high)} ${unit === "1" ? "" : unit}`.trim(),
    rows,
    columns: [["mean", name], ["68 %, lower", `${name}_lower_68`], ["68 %, upper", `${name}_upper_68`], ["95 %, lower", `${name}_lower_95`], ["95 %, upper", `${name}_upper_95`]].map(([head, column]) => [`${head} [${unit}]`, column, scale]),
  };
}

/** Range of an axis: the prior's band, many times wider than what is learnt, may leave the picture. */
function range(low, high, inside) {
  const values = (points) => points.map((point) => point.y).filter((value) => value !== null);
  const [lows, highs, others] = [low, high, inside].map((points) => values(points).sort((a, b) => a - b));
  if (!highs.length) return { min: 0, max: undefined };
  const max = Math.max(highs[Math.floor(0.8 * (highs.length - 1))], ...others.slice(-1));
  const min = Math.min(lows[Math.ceil(0.2 * (lows.length - 1))], ...others.slice(0, 1));
  const room = 0.2 * (max - min);
  return { min: min - room < 0.4 * max ? 0 : min - room, max: max + room };
}

/** Mean over the last seconds, since the noise of one measurement hides the motion of a wheel. */
function calmed(points) {
  let first = 0, sum = 0, count = 0;
  const add = (value, sign) => { if (value !== null) { sum += sign * value; count += sign; } };
  return points.map(({ x, y }, k) => {
    add(y, 1);
    for (; first < k && points[first].x <= x - CALM_S; first += 1) add(points[first].y, -1);
    return { x, y: y === null || count === 0 ? null : sum / count };
  });
}

function wheels(name, title, unit, scale, chart, store, rows, span) {
  const names = store.begin.wheels;
  if (chart.data.datasets.length !== names.length || names.some((wheel, k) => chart.data.datasets[k].label !== plain(wheel))) wheelLines(chart, names.map(plain));
  names.forEach((_, k) => { chart.data.datasets[k].data = calmed(store.points(rows, `${name}_${k}`, scale)); });
  fitTime(chart, span);
  const measured = store.now[`wheel_${name}`] ?? { wheel: [], [name]: [] };
  const now = names.map((wheel) => measured[name][measured.wheel.indexOf(wheel)] ?? null); // each topic has an order of its own
  return {
    words: `${title} ${when(store, `wheel_${name}`)}: ${names.map((wheel, k) => `${plain(wheel)} ${number(now[k] === null ? null : scale * now[k])}`).join(", ")} ${unit === "1" ? "" : unit}`.trim(),
    rows,
    columns: names.map((wheel, k) => [`${plain(wheel)} [${unit}]`, `${name}_${k}`, scale]),
  };
}

function fitTime(chart, [min, max]) {
  Object.assign(chart.options.scales.x, { min, max });
}

/** Stretches of one value, with their first and last times. */
function runs(points, end) {
  const found = [];
  points.forEach(({ x, y }, k) => {
    const to = points[k + 1]?.x ?? end, last = found[found.length - 1];
    if (y === null) return;
    if (last && last.value === y && last.to === x) last.to = to;
    else found.push({ from: x, to, value: y });
  });
  return found;
}

/** The last rows as a table, the newest first. */
function fill(table, store, { rows, columns }) {
  const head = make("tr", {}, make("th", { scope: "col" }, "Time"), ...columns.map(([name]) => make("th", { scope: "col", class: "figure" }, name)));
  const body = rows.slice(-LISTED).reverse().map((row) => make("tr", {}, make("th", { scope: "row" }, time(row[0], store)), ...columns.map((column) => cell(row, store, column))));
  table.replaceChildren(make("thead", {}, head), make("tbody", {}, ...body));
}

const tenths = (seconds) => fixed(Math.floor(10 * (seconds % 1)) / 10, 1).slice(-2);
const time = (seconds, store) => `${clock(seconds + store.origin)}${tenths(seconds + store.origin)}`;

function cell(row, store, [, column, scale]) {
  const value = row[store.index[column]], data = make("data");
  const text = typeof scale === "function" ? (value === null ? "–" : scale(value)) : number(value === null ? null : scale * value);
  show(data, value, text);
  return make("td", { class: "figure" }, data);
}
