// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
// The page: new data enters the numbers at once, and the charts twice a second.

import { drawCharts, makeCharts, restyle } from "/drawing.js";
import { connect } from "/live.js";
import { Store } from "/store.js";
import { showTables } from "/tables.js";
import { clock, duration, isTimeOfDay, number, plain, say, show } from "/words.js";

const DRAWN_MS = 500;
const LEVELS = { IDENTIFIED: ["good", "✓"], CONVERGING: ["quiet", "…"], PRIOR_ONLY: ["quiet", "…"], STANDING_STILL: ["quiet", "❚❚"], DEGRADED: ["warn", "▲"], DISAGREES: ["bad", "✕"] };

const store = new Store();
const view = { whole: false, origin: 0, connected: false, paused: false };
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
  showMost("slip", "wheel_slip", 1);
  showMost("sinkage", "wheel_sinkage", 1000);
}

function showMost(name, topic, scale) {
  const { wheel = [], [name]: values = [] } = store.now[topic] ?? {};
  const k = values.reduce((best, value, at) => (value !== null && (best < 0 || value > values[best]) ? at : best), -1);
  const target = element(`most-${name}`).firstElementChild;
  show(target, k < 0 ? null : values[k], number(k < 0 ? null : scale * values[k]));
  say(element(`most-${name}-wheel`), k >= 0 ? plain(wheel[k]) : wheel.length ? unmeasured() : "no data");
}

const unmeasured = () => (store.now.terrain_estimate?.status === "STANDING_STILL" ? "no value: the rover stands" : "no wheel has a value now");

/** Grey out what is no longer current, and write its age beside it. */
function showAges() {
  for (const each of document.querySelectorAll("[data-topics]")) {
    const old = each.dataset.topics.split(" ").filter((topic) => store.isStale(topic));
    each.classList.toggle("stale", old.length > 0);
    const ages = old.map((topic) => store.age(topic));
    say(each.querySelector(".age"), old.length ? `not current: ${duration(Math.max(...ages))} old` : "");
  }
  for (const name of ["cohesion", "tan_phi"]) {
    const known = store.isStale("terrain_estimate") ? null : store.at(`terrain_estimate/${name}_identified`);
    const open = store.now.terrain_estimate?.status === "DISAGREES" ? "✕ the prior: the model does not fit" : "… not identified yet";
    say(element(`${name}-known`), known === null ? "" : known ? "✓ identified" : open);
  }
}

function showVerdict() {
  const estimate = store.now.terrain_estimate, stale = store.isStale("terrain_estimate");
  const [level, sign] = stale ? ["old", "▲"] : (estimate && LEVELS[estimate.status]) ?? ["quiet", "…"];
  element("verdict").dataset.level = level;
  say(element("sign"), sign);
  say(element("status"), stale ? "no current estimate" : estimate ? plain(estimate.status) : "waiting");
  if (stale) say(element("status-text"), `The last estimate is ${duration(store.age("terrain_estimate"))} old. The numbers below are those of that time.`);
  else if (estimate) say(element("status-text"), sentence(estimate.status, estimate.status_text));
}

/** A stop, which holds until it is withdrawn, even where the planner has ended; else its limit. */
function showAdvice() {
  const advice = store.now.traction_advice, since = store.age("traction_advice");
  element("stopped").hidden = !advice?.stop;
  if (advice?.stop) {
    say(element("stop"), `Stop: ${advice.status_text}`);
    say(element("stop-age"), store.isStale("traction_advice") ? `The planner has sent no advice for ${duration(since)}.` : "");
    say(element("resume"), `ros2 service call ${store.begin.resume} std_srvs/srv/Trigger`);
  }
  say(element("advice"), advised(advice, since));
  document.title = advice?.stop ? "■ Stop – Live terrain" : "Live terrain";
}

/** The present advice: an old speed limit no longer applies. */
function advised(advice, since) {
  if (!advice) return "no planner";
  if (store.isStale("traction_advice")) return `planner: ${advice.stop ? "stop; " : ""}no advice for ${duration(since)}`;
  if (advice.stop) return "planner: stop";
  return advice.known && advice.speed_limit !== null ? `planner: at most ${number(advice.speed_limit)} m/s` : "planner: no limit yet";
}

/** The status in words without its name, which the badge shows. */
function sentence(status, text) {
  const rest = text.startsWith(plain(status)) ? text.slice(plain(status).length).replace(/^; /, "") : text;
  return rest ? rest[0].toUpperCase() + rest.slice(1) : "The data determine cohesion and friction.";
}

function showConnection() {
  const since = store.age("terrain_estimate");
  let state = "live", text = "live";
  if (view.paused) [state, text] = ["wait", "paused"];
  else if (!view.connected) [state, text] = ["lost", "connection lost, trying again"];
  else if (since === undefined) [state, text] = ["wait", "waiting for the estimator"];
  else if (store.isStale("terrain_estimate")) [state, text] = ["silent", "no new estimates"];
  const pill = element("connection");
  pill.dataset.state = state;
  say(pill, text);
  const silent = state === "silent" ? `, the last one ${duration(since)} ago` : "";
  say(element("clock"), store.time === null ? "" : `${clock(store.time)}${isTimeOfDay(store.time) ? " UTC" : ""}${silent}`);
}

/** Show everything that changes with time alone, too. */
function showState() {
  showConnection();
  showVerdict();
  showAdvice();
  showAges();
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
      showNumbers();
      showTables(store);
      const loud = events.filter((event) => event.level !== "ok");
      if (loud.length) say(element("announcement"), loud[loud.length - 1].text);
      showState();
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
  setInterval(() => { showState(); drawCharts(store, view, false); }, DRAWN_MS);
}

start();
