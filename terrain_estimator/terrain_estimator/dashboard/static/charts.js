// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
// The charts, drawn by Chart.js in the colours of the page.

import { clock, number } from "/words.js";

const STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400];
const TICKS = 6;
const DASHES = [[], [6, 3]];
export const WHEEL_COLOURS = 8;

let colours = {};
const colour = (name) => colours[name];
const tint = (alpha) => `rgba(${colours.band}, ${alpha})`;

/** Read the colours of the style sheet; called again after a change between light and dark. */
export function readColours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "quiet", "line", "paper", "accent", "bad", "warn", "good", "band"];
  for (let k = 0; k < WHEEL_COLOURS; k += 1) names.push(`w${k}`);
  colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  Chart.defaults.color = colours.ink;
  Chart.defaults.borderColor = colours.line;
  Chart.defaults.font.family = getComputedStyle(document.body).fontFamily;
  Chart.defaults.font.size = 12.5;
}

/** Time axis with ticks at round clock times, wherever the axis begins. */
function timeAxis(view) {
  return {
    type: "linear",
    ticks: { callback: (value) => clock(value + view.origin), maxRotation: 0 },
    afterBuildTicks(axis) {
      const room = Math.max(2, Math.min(TICKS, Math.floor(axis.width / 75)));
      const step = STEPS.find((each) => (axis.max - axis.min) / each <= room) ?? STEPS[STEPS.length - 1];
      const first = Math.ceil((axis.min + view.origin) / step) * step - view.origin;
      axis.ticks = [];
      for (let value = first; value <= axis.max; value += step) axis.ticks.push({ value });
    },
  };
}

const base = (view, more = {}) => ({
  animation: false,
  responsive: true,
  maintainAspectRatio: false,
  parsing: false,
  normalized: true,
  interaction: { mode: "index", intersect: false },
  plugins: {
    legend: { display: false },
    tooltip: { callbacks: { title: (items) => items.length && clock(items[0].parsed.x + view.origin), label: (item) => ` ${item.dataset.label}: ${number(item.parsed.y)}` } },
  },
  elements: { point: { radius: 0 }, line: { borderWidth: 2 } },
  ...more,
});

const canvas = (name) => document.querySelector(`#${name} canvas`);

/** Mean with its bands of 68 and 95 %, and the truth where it is known. */
export function bandChart(name, view) {
  const side = (label, alpha) => ({ label, fill: alpha ? "-1" : false, backgroundColor: () => tint(alpha), borderWidth: 0, data: [] });
  const datasets = [
    side("95 %, lower", 0), side("95 %, upper", 0.2), side("68 %, lower", 0), side("68 %, upper", 0.3),
    { label: "mean", borderColor: () => colour("accent"), data: [] },
    { label: "truth", borderColor: () => colour("ink"), borderDash: [5, 4], borderWidth: 1.5, stepped: "before", data: [] },
  ];
  return new Chart(canvas(name), { type: "line", data: { datasets }, options: base(view, { scales: { x: timeAxis(view), y: {} } }) });
}

/** One line for every wheel. */
export function wheelChart(name, view) {
  return new Chart(canvas(name), { type: "line", data: { datasets: [] }, options: base(view, { scales: { x: timeAxis(view), y: { suggestedMin: 0 } } }) });
}

/** Line style of a wheel: a colour for each pair, dashes for the second of a pair. */
export const wheelLook = (k) => ({ colour: `w${Math.floor(k / 2) % WHEEL_COLOURS}`, dash: DASHES[k % 2] });

export function wheelLines(chart, wheels) {
  chart.data.datasets = wheels.map((label, k) => {
    const look = wheelLook(k);
    return { label, borderColor: () => colour(look.colour), borderDash: look.dash, data: [] };
  });
}

export function areaChart(name, view, label) {
  const dataset = { label, borderColor: () => colour("accent"), backgroundColor: () => tint(0.25), fill: "origin", data: [] };
  return new Chart(canvas(name), { type: "line", data: { datasets: [dataset] }, options: base(view, { scales: { x: timeAxis(view), y: { min: 0, max: 100 } } }) });
}

/** Lanes of states over time: bars with their names where these fit. */
export function timelineChart(name, view, lanes) {
  const options = base(view, {
    parsing: true, // of the ends of a bar
    normalized: false,
    indexAxis: "y",
    interaction: { mode: "nearest", intersect: true },
    scales: { x: timeAxis(view), y: { type: "category", labels: lanes, grid: { display: false } } },
  });
  options.plugins.tooltip = { callbacks: {
    title: ([item]) => item?.raw.state ?? "",
    label: (item) => ` ${clock(item.raw.x[0] + view.origin)} to ${clock(item.raw.x[1] + view.origin)}`,
  } };
  const dataset = {
    label: "states", data: [], grouped: false, borderSkipped: false, barPercentage: 0.9, categoryPercentage: 0.85, borderWidth: 0, minBarLength: 2,
    backgroundColor: (item) => fills()[item.raw?.look ?? "idle"],
  };
  return new Chart(canvas(name), { type: "bar", data: { datasets: [dataset] }, options, plugins: [{ id: "names", afterDatasetsDraw: drawNames }] });
}

const fills = () => ({ good: colour("good"), some: tint(0.35), idle: colour("line"), warn: hatch(colour("warn")), bad: colour("bad") });

/** Hatching, so that a warning is recognised without its colour. */
function hatch(ink) {
  const tile = document.createElement("canvas");
  tile.width = tile.height = 8;
  const pen = tile.getContext("2d");
  pen.fillStyle = colour("paper");
  pen.fillRect(0, 0, 8, 8);
  pen.strokeStyle = ink;
  pen.lineWidth = 3;
  pen.beginPath();
  for (const shift of [-8, 0, 8]) { pen.moveTo(shift, 8); pen.lineTo(shift + 8, 0); }
  pen.stroke();
  return pen.createPattern(tile, "repeat");
}

function drawNames(chart) {
  const pen = chart.ctx;
  pen.save();
  pen.font = `12px ${Chart.defaults.font.family}`;
  pen.textBaseline = "middle";
  chart.getDatasetMeta(0).data.forEach((bar, k) => {
    const item = chart.data.datasets[0].data[k];
    const left = Math.max(Math.min(bar.base, bar.x), chart.chartArea.left), right = Math.min(Math.max(bar.base, bar.x), chart.chartArea.right);
    const wide = pen.measureText(item.state).width + 8;
    if (right - left < wide) return;
    pen.fillStyle = item.look === "good" || item.look === "bad" ? colour("paper") : colour("ink");
    if (item.look === "warn") {
      pen.fillStyle = colour("paper");
      pen.fillRect(left + 3, bar.y - 9, wide - 2, 18);
      pen.fillStyle = colour("ink");
    }
    pen.fillText(item.state, left + 6, bar.y + 1);
  });
  pen.restore();
}

const placeAxis = (text) => ({ title: { display: true, text }, ticks: { includeBounds: false } });

/** Lines over distance or in the plane, with the rover at the end of the first. */
export function placeChart(name, view, axes, grace) {
  const line = { label: "track", showLine: true, borderColor: () => colour("accent"), data: [] };
  const rover = { label: "rover", pointStyle: () => arrow(), radius: 10, data: [] };
  const options = base(view, { interaction: { mode: "nearest", intersect: false }, scales: { x: placeAxis(axes[0]), y: { ...placeAxis(axes[1]), grace } } });
  options.plugins.tooltip = { callbacks: { label: (item) => ` ${axes[0]} ${number(item.parsed.x)}, ${axes[1]} ${number(item.parsed.y)}` } };
  options.layout = { padding: { right: 12, top: 8 } };
  return new Chart(canvas(name), { type: "scatter", data: { datasets: [rover, line] }, options });
}

/** The rover, pointing upwards. */
function arrow() {
  const tile = document.createElement("canvas"), pen = tile.getContext("2d");
  tile.width = tile.height = 26;
  pen.beginPath();
  for (const [x, y] of [[13, 1], [21, 24], [13, 19], [5, 24]]) pen.lineTo(x, y);
  pen.closePath();
  pen.fillStyle = colour("bad");
  pen.strokeStyle = colour("ink");
  pen.lineWidth = 1.5;
  pen.fill();
  pen.stroke();
  return tile;
}

/** Equal scales upwards and to the right. */
export function fitPlane(chart, points) {
  const known = points.filter((point) => point.x !== null && point.y !== null);
  if (!known.length) return;
  const area = chart.chartArea, [xs, ys] = ["x", "y"].map((axis) => known.map((point) => point[axis]));
  const span = (values) => ({ low: Math.min(...values), high: Math.max(...values), middle: (Math.min(...values) + Math.max(...values)) / 2 });
  const x = span(xs), y = span(ys);
  const metres = 1.1 * Math.max((x.high - x.low) / area.width, (y.high - y.low) / area.height, 1 / area.width);
  Object.assign(chart.options.scales.x, { min: x.middle - (metres * area.width) / 2, max: x.middle + (metres * area.width) / 2 });
  Object.assign(chart.options.scales.y, { min: y.middle - (metres * area.height) / 2, max: y.middle + (metres * area.height) / 2 });
}
