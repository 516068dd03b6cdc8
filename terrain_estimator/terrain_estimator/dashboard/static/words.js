// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
// Numbers and times as people read them.

const ABSENT = "–";
const SECOND_OF_2001 = 978307200; // later stamps are times of day, earlier ones those of a simulation

/** A number with two digits of its deviation where there is one, else with three significant digits. */
export function number(value, sd) {
  if (value === null || value === undefined) return ABSENT;
  const places = sd > 0 ? 1 - Math.floor(Math.log10(sd)) : value === 0 ? 0 : 2 - Math.floor(Math.log10(Math.abs(value)));
  return signed(value.toFixed(Math.min(Math.max(places, 0), 6)));
}

export const fixed = (value, places) => (value === null || value === undefined ? ABSENT : signed(value.toFixed(places)));

/** A number as text with a proper minus, and none before a zero. */
const signed = (text) => text.replace("-", Number(text) === 0 ? "" : "−");

/** A time of day (UTC), or minutes and seconds of a simulation. */
export function clock(seconds) {
  if (seconds > SECOND_OF_2001) return new Date(1000 * seconds).toISOString().slice(11, 19);
  const whole = Math.floor(Math.abs(seconds));
  return `${seconds < 0 && whole > 0 ? "−" : ""}${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** A duration in its two largest units. */
export function duration(seconds) {
  const whole = Math.max(Math.round(seconds), 0), minutes = Math.floor(whole / 60), hours = Math.floor(minutes / 60);
  if (hours >= 48) return `${Math.floor(hours / 24)} d ${hours % 24} h`;
  if (hours) return `${hours} h ${minutes % 60} min`;
  return minutes ? `${minutes} min ${whole % 60} s` : `${whole} s`;
}

export const isTimeOfDay = (seconds) => seconds > SECOND_OF_2001;
export const plain = (name) => name.toLowerCase().replaceAll("_", " ");

/** Set text only where it differs, so that it is not read out again and selections stay. */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Show a number in a <data> element, whose value is the number in full. */
export function show(element, value, text) {
  say(element, text);
  if (value === null || value === undefined) element.removeAttribute("value");
  else if (element.value !== String(value)) element.value = String(value);
}

/** Make an element with attributes and children. */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}
