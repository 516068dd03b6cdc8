// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
// The page: new data enters the numbers at once, and the charts twice a second.

import { drawCharts, makeCharts, restyle } from "/drawing.js";
import { connect } from "/live.js";
import { Store } from "/store.js";
import { showTables } from "/tables.js";
import { clock, isTimeOfDay, number, plain, say, show } from "/words.js";

const DRAWN_MS = 500;
const SILENT_S = 2.5;
const LEVELS = { IDENTIFIED: ["good", "✓"], CONVERGING: ["quiet", "…"], PRIOR_ONLY: ["quiet", "…"], STANDING_STILL: ["quiet", "❚❚"], DEGRADED: ["warn", "▲"] };

const store = new Store();
const view = { whole: false, origin: 0, connected: false, paused: false, came: 0 };
const element = (id) => document.getElementById(id);

/** Fill in every <data data-path="..."> of the page. */
function showNumbers() {
  for (const each of document.querySelectorAll("data[data-path]")) {
    const scale = Number(each.dataset.scale), value = store.at(each.dataset.path);
    const sd = each.dataset.sd ? scale * store.at(each.dataset.sd) : 0;
    show(each, value, number(value === null ? null : scale * value, sd));
  }
  say(element("frame"), store.now.odom?.frame ? `in the frame ${store.now.odom.frame}` : "");
  say(element("model"), store.now.terrain_estimate ? `Model ${store.now.terrain_estimate.model}.` : "");
  for (const name of ["cohesion", "tan_phi"]) {
    const known = store.at(`terrain_estimate/${name}_identified`);
    say(element(`${name}-known`), known === null ? "" : known ? "✓ identified" : "… not identified yet");
  }
  showMost("slip", "wheel_slip", 1);
  showMost("sinkage", "wheel_sinkage", 1000);
}

function showMost(name, topic, scale) {
  const { wheel = [], [name]: values = [] } = store.now[topic] ?? {};
  const k = values.reduce((best, value, at) => (value !== null && (best < 0 || value > values[best]) ? at : best), -1);
  const target = element(`most-${name}`).firstElementChild;
  show(target, k < 0 ? null : values[k], number(k < 0 ? null : scale * values[k]));
  say(element(`most-${name}-wheel`), k >= 0 ? plain(wheel[k]) : wheel.length ? "not measured now" : "no data");
}

/** Time since the last message of a topic [s]; undefined where there was none. */
function age(topic) {
  const then = store.ages[topic];
  return then === undefined ? undefined : then + (performance.now() - view.came) / 1000;
}

function showVerdict() {
  const estimate = store.now.terrain_estimate, advice = store.now.traction_advice;
  const [level, sign] = (estimate && LEVELS[estimate.status]) ?? ["quiet", "…"];
  element("verdict").dataset.level = advice?.stop ? "stop" : level;
  say(element("sign"), sign);
  say(element("status"), estimate ? plain(estimate.status) : "waiting");
  if (estimate) say(element("status-text"), sentence(estimate.status, estimate.status_text));
  element("stop").hidden = !advice?.stop;
  if (advice?.stop) say(element("stop"), `Stop: ${advice.status_text}`);
  say(element("advice"), advised(advice, age("traction_advice")));
  document.title = advice?.stop ? "■ Stop – Live terrain" : "Live terrain";
}

/** The present advice: an old speed limit no longer applies, a stop holds until it is withdrawn. */
function advised(advice, since) {
  if (!advice) return "no planner";
  if (since > SILENT_S) return `planner: ${advice.stop ? "stop; " : ""}no advice for ${Math.round(since)} s`;
  if (advice.stop) return "planner: stop";
  return advice.known && advice.speed_limit !== null ? `planner: at most ${number(advice.speed_limit)} m/s` : "planner: no limit yet";
}

/** The status in words without its name, which the badge shows. */
function sentence(status, text) {
  const rest = text.startsWith(plain(status)) ? text.slice(plain(status).length).replace(/^; /, "") : text;
  return rest ? rest[0].toUpperCase() + rest.slice(1) : "The data determine cohesion and friction.";
}

function showConnection() {
  const since = age("terrain_estimate");
  let state = "live", text = "live";
  if (view.paused) [state, text] = ["wait", "paused"];
  else if (!view.connected) [state, text] = ["lost", "connection lost, trying again"];
  else if (since === undefined) [state, text] = ["wait", "waiting for the estimator"];
  else if (since > SILENT_S) [state, text] = ["silent", "no new estimates"];
  const pill = element("connection");
  pill.dataset.state = state;
  say(pill, text);
  element("now").classList.toggle("stale", state === "lost" || state === "silent");
  const silent = state === "silent" ? `, the last one ${Math.round(since)} s ago` : "";
  say(element("clock"), store.time === null ? "" : `${clock(store.time)}${isTimeOfDay(store.time) ? " UTC" : ""}${silent}`);
}

function press(id, pressed) {
  element(id).setAttribute("aria-pressed", String(pressed));
}

function start() {
  makeCharts(store, view);
  const live = connect(
    (answer) => {
      const events = store.take(answer);
      view.origin = store.origin;
      view.came = performance.now();
      showNumbers();
      showVerdict();
      showTables(store);
      const loud = events.filter((event) => event.level !== "ok");
      if (loud.length) say(element("announcement"), loud[loud.length - 1].text);
      showConnection();
    },
    (connected) => {
      view.connected = connected;
      showConnection();
    },
  );
  const choose = (whole) => {
    view.whole = whole;
    press("recent", !whole);
    press("whole", whole);
    drawCharts(store, view, true);
  };
  element("recent").addEventListener("click", () => choose(false));
  element("whole").addEventListener("click", () => choose(true));
  element("pause").addEventListener("click", () => {
    view.paused = !view.paused;
    press("pause", view.paused);
    live.pause(view.paused);
    showConnection();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { restyle(); drawCharts(store, view, true); });
  setInterval(() => { showConnection(); if (!view.paused) showVerdict(); drawCharts(store, view, false); }, DRAWN_MS);
}

start();
