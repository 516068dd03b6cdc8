// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
// The tables of wheels, effects, fit and inputs of the estimator, and the journal.

import { wheelLook } from "/charts.js";
import { clock, fixed, make, number, plain, say, show } from "/words.js";

const NORMAL_95 = 1.959964; // half width of the 95 % interval of a Gaussian, in deviations
const element = (id) => document.getElementById(id);

export function showTables(store) {
  showWheels(store);
  showEffects(store.now.terrain_estimate);
  showFit(store.now.terrain_estimate);
  showHealth(store.now.estimator_health);
  showJournal(store);
}

/** Keep one row for each key, made once and then only updated. */
function rowsFor(body, keys, build) {
  const present = [...body.children].map((row) => row.dataset.key);
  if (present.length !== keys.length || keys.some((key, k) => key !== present[k])) {
    body.replaceChildren(...keys.map((key, k) => {
      const row = build(key, k);
      row.dataset.key = key;
      return row;
    }));
  }
  return [...body.children];
}

const figure = () => make("td", { class: "figure" }, make("data"));
const bar = () => make("td", { class: "wide", "aria-hidden": "true" }, make("span", { class: "bar" }));

function showWheels(store) {
  const wheels = store.begin.wheels;
  if (!wheels.length) return;
  const rows = rowsFor(element("wheel-table").tBodies[0], wheels, (name, k) => make("tr", {}, make("th", { scope: "row" }, swatch(k), plain(name)), figure(), bar(), figure(), bar()));
  const sinkage = store.now.wheel_sinkage ?? { wheel: [], sinkage: [], sinkage_stddev: [] };
  const slip = store.now.wheel_slip ?? { slip: [], slip_stddev: [] };
  const deepest = Math.max(0.02, ...sinkage.sinkage.map((value) => value ?? 0));
  rows.forEach((row, k) => {
    const at = sinkage.wheel.indexOf(wheels[k]), cells = row.children;
    put(cells[1], cells[2], slip.slip[k], slip.slip_stddev[k], 1, 1);
    put(cells[3], cells[4], sinkage.sinkage[at], sinkage.sinkage_stddev[at], 1000, deepest);
  });
}

function put(cell, meter, value = null, sd = null, scale, full) {
  show(cell.firstChild, value, number(value === null ? null : scale * value, sd === null ? 0 : scale * sd));
  meter.firstChild.style.width = `${value === null ? 0 : Math.min(Math.max(value / full, 0), 1) * 100}%`;
}

/** The line of a wheel as the charts draw it. */
function swatch(k) {
  const look = wheelLook(k), svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  for (const [name, value] of Object.entries({ width: 28, height: 10, "aria-hidden": "true", focusable: "false" })) svg.setAttribute(name, value);
  for (const [name, value] of Object.entries({ x1: 0, y1: 5, x2: 28, y2: 5, class: "line", "stroke-dasharray": look.dash.join(" ") })) line.setAttribute(name, value);
  line.style.stroke = `var(--${look.colour})`;
  svg.append(line);
  return svg;
}

function showEffects(estimate) {
  const names = estimate?.effect ?? [];
  element("no-effects").hidden = names.length > 0;
  element("effect-table").hidden = names.length === 0;
  const rows = rowsFor(element("effect-table").tBodies[0], names, (name) => make("tr", {}, make("th", { scope: "row" }, make("code", {}, name)), make("td", {}, make("data"), " ± ", make("data"), make("span")), make("td", { class: "range" }), make("td")));
  rows.forEach((row, k) => {
    const value = estimate.effect_value[k], sd = estimate.effect_stddev[k], unit = estimate.effect_unit[k];
    const [size, deviation, label] = row.children[1].children;
    show(size, value, number(value, sd));
    show(deviation, sd, number(sd, sd));
    say(label, unit === "1" ? "" : ` ${unit}`);
    if (value === null || sd === null) return;
    const [low, high] = [value - NORMAL_95 * sd, value + NORMAL_95 * sd];
    say(row.children[2], `${number(low, sd)} to ${number(high, sd)}`);
    say(row.children[3], low > 0 || high < 0 ? "● not zero" : "○ may be zero");
  });
}

/** Each row's offset and spread, in predicted deviations. */
function showFit(estimate) {
  const names = estimate?.fit_row ?? [];
  element("no-fit").hidden = names.length > 0;
  element("fit-table").hidden = names.length === 0;
  const rows = rowsFor(element("fit-table").tBodies[0], names, (name) => make("tr", {}, make("th", { scope: "row" }, make("code", {}, name)), figure(), figure()));
  rows.forEach((row, k) => [estimate.fit_offset[k], estimate.fit_spread[k]].forEach((value, at) => show(row.children[at + 1].firstChild, value, fixed(value, 2))));
}

function showHealth(health) {
  if (!health) return;
  const summary = element("health-summary");
  summary.classList.remove("absent");
  say(summary, `${health.level}: ${health.summary}`);
  const pairs = {
    "seconds taken": [health.seconds_taken, 0],
    "seconds refused": [health.seconds_refused, 0],
    "observations used": [health.accepted, 0],
    ...Object.fromEntries(Object.entries(health.outcomes).filter(([name]) => name !== "ACCEPTED").map(([name, count]) => [plain(name), [count, 0]])),
    "innovation (NIS, near 1 when consistent)": [health.normalized_innovation_squared, 2],
    "latency, median [ms]": [health.update_latency_median, 2, 1000],
    resets: [health.resets, 0],
  };
  const entries = rowsFor(element("counts"), Object.keys(pairs), (name) => make("div", {}, make("dt", {}, name), make("dd", {}, make("data"))));
  entries.forEach((entry, k) => {
    const [value, places, scale = 1] = Object.values(pairs)[k];
    show(entry.lastChild.firstChild, value, fixed(value === null ? null : scale * value, places));
  });
  element("inputs").hidden = health.inputs.length === 0;
  const rows = rowsFor(element("inputs").tBodies[0], health.inputs.map((input) => input.topic), (topic) => make("tr", {}, make("th", { scope: "row" }, topic), figure(), figure(), figure(), figure()));
  rows.forEach((row, k) => ["received", "unpaired", "lost", "age"].forEach((name, at) => {
    const value = health.inputs[k][name];
    show(row.children[at + 1].firstChild, value, fixed(value, name === "age" ? 1 : 0));
  }));
}

function showJournal(store) {
  const list = element("journal"), events = store.journal.toReversed();
  if (!events.length) return;
  const key = (event) => `${store.begin.window}/${event.number}/${event.time_s}`;
  const present = new Map([...list.children].map((item) => [item.dataset.key, item]));
  const wanted = events.map((event) => present.get(key(event)) ?? entry(event, key(event)));
  if (wanted.length !== list.children.length || wanted.some((item, k) => item !== list.children[k])) list.replaceChildren(...wanted);
}

function entry(event, key) {
  const item = make("li", { "data-level": event.level, "data-key": key }, make("time", {}, clock(event.time_s)), event.text);
  return item;
}
