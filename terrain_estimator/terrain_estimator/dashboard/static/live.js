// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
// The connection to the node. The page asks for what is new, shows it, and asks again: a slow page
// asks less often, a hidden or paused one not at all. A hidden page that loses its connection opens
// another when it is in sight again.

const FIRST_RETRY_MS = 500;
const LONGEST_RETRY_MS = 4000;
const PATIENCE_MS = 6000; // the node answers every second at least

/** Call `answered(answer)` for every answer, and `changed(connected)` when the connection comes or goes. */
export function connect(answered, changed) {
  let socket, cursor = {}, retry = FIRST_RETRY_MS, patience, owed = false, away = false, paused = false;

  const ask = () => {
    if (socket.readyState !== WebSocket.OPEN) return;
    owed = paused || document.hidden;
    clearTimeout(patience);
    if (owed) return;
    socket.send(JSON.stringify(cursor));
    patience = setTimeout(() => socket.close(), PATIENCE_MS);
  };
  const open = () => {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    socket.onopen = ask;
    socket.onmessage = (event) => {
      retry = FIRST_RETRY_MS;
      const answer = JSON.parse(event.data);
      cursor = answer.cursor;
      changed(true);
      answered(answer);
      ask();
    };
    socket.onclose = () => {
      clearTimeout(patience);
      changed(false);
      away = document.hidden;
      if (away) return;
      setTimeout(open, retry);
      retry = Math.min(2 * retry, LONGEST_RETRY_MS);
    };
  };
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) return;
    if (away) open();
    else if (owed) ask();
    away = false;
  });
  open();
  return { pause(value) { paused = value; if (owed) ask(); } };
}
