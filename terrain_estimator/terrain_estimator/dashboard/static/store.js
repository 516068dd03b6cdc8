// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
// Data from the node: rows over time, the journal, and the present values.

const SILENT_S = 2.5; // age from which a value is not current; messages come at 1 Hz or more often

export class Store {
  begin = { columns: [], wheels: [], outcomes: [], statuses: [], levels: [], window: 120 };
  recent = [];
  whole = [];
  journal = [];
  now = {};
  ages = {};
  time = null;
  origin = 0;
  came = 0; // time of the last answer [ms]

  /** Take an answer; return the events that are new to a page that was already open. */
  take(answer) {
    if (answer.begin) {
      Object.assign(this, { begin: answer.begin, recent: [], whole: [], journal: [] });
      this.index = Object.fromEntries(answer.begin.columns.map((name, k) => [name, k]));
    }
    for (const part of ["recent", "whole", "journal"]) this[part].push(...answer[part]);
    Object.assign(this, { now: answer.now, ages: answer.ages, time: answer.time, origin: answer.origin ?? 0, came: performance.now() });
    const first = this.recent.findIndex((row) => row[0] >= this.end - this.begin.window);
    this.recent.splice(0, Math.max(first, 0));
    this.journal.splice(0, this.journal.length - 100);
    return answer.begin ? [] : answer.journal;
  }

  /** Time since the last message of a topic [s]; undefined where there was none. */
  age(topic) {
    const then = this.ages[topic];
    return then === undefined ? undefined : then + (performance.now() - this.came) / 1000;
  }

  /** Whether the values of a topic are no longer current. */
  isStale(topic) {
    return this.age(topic) > SILENT_S;
  }

  /** Time of the newest measurement, from the beginning of the history [s]. */
  get end() {
    return this.time === null ? 0 : this.time - this.origin;
  }

  /** The rows of the whole drive, the last of them in full. */
  get drive() {
    const last = this.whole.length ? this.whole[this.whole.length - 1][0] : -1;
    return [...this.whole, ...this.recent.filter((row) => row[0] > last)];
  }

  /** Points {x: time, y: value} of a column. */
  points(rows, column, scale = 1) {
    const k = this.index?.[column];
    return rows.map((row) => ({ x: row[0], y: row[k] === null || k === undefined ? null : scale * row[k] }));
  }

  /** The value at a path such as "odom/x". */
  at(path) {
    return path.split("/").reduce((values, name) => values?.[name], this.now) ?? null;
  }
}
