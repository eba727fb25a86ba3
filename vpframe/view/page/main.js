// ---- messages: live from the socket, or embedded in the file -----------------------------------------------------------

function receive(message) {
  if (message.type === "scene") { showScene(message); begin(message); }
  else if (message.type === "you") world.client = message.client;
  else if (message.type === "strips") keepStrips(message);
  else if (message.type === "frame") receiveFrame(message);
  else if (message.type === "newest") grow(message.frame);
  else if (message.type === "events") hear(message.events);
  else if (message.type === "undone") forget(message.frame);
  else if (message.type === "desk") showDesk(message);
  else if (message.type === "clashes") showFound(message);
  else if (message.type === "freedom") showFreedom(message.rows);
  else if (message.type === "say") say(message.text);
  else if (message.type === "script")
    download(`data:text/x-python;charset=utf-8,${encodeURIComponent(world.script = message.text)}`, message.name);
  else if (message.type === "over") over();
}

function receiveFrame(frame) {
  if (frame.back !== Boolean(timeline.back)) return; // it was on its way when the person looked elsewhere
  timeline.shown = frame.number;
  showFrame(frame);
  if (!frame.back) grow(frame.number);
}

function begin(info) {
  showTree();
  showLegend();
  $("hand").hidden = !info.hand;
  for (const name of ["play", "pause", "one"]) $(name).hidden = Boolean(info.hand) || (!socket && name !== "play");
  showHandOf();
}

for (const [name, action, status] of [["play", "play", ""], ["pause", "pause", "paused"], ["one", "step", "paused"]])
  $(name).onclick = () => { send({ action }); $("status").textContent = status; };

listenToMouse();
const embedded = JSON.parse($("embedded").textContent);
if (embedded) replay(embedded); else live();
