// ---- time: looking back while the session runs, or playing what is embedded in the file --------------------------------
// `go` shows a frame by its number; live that asks the server, which keeps them.
const timeline = { newest: 0, shown: 0, events: [], heard: [], go: () => {}, asked: null };
const looking = () => Boolean(socket) && timeline.back === true;

function grow(newest) {
  timeline.newest = Math.max(timeline.newest, newest);
  tellSoon();
}

// The session went back to a frame: what followed did not happen.
function forget(newest) {
  timeline.newest = newest;
  timeline.events = [];
  timeline.heard = [];
  $("events").replaceChildren();
  world.trail.clear();
  viewer.delete_path(["trail"]);
  tellSoon();
}

function markEvent(event) {
  if (event.frame === null || event.frame === undefined) return;
  timeline.events.push(event);
  if (timeline.events.length > 1000) timeline.events.shift();
}

// Events of the session: `tell` writes them.
function hear(events) {
  events.forEach(markEvent);
  timeline.heard.push(...events);
  tellSoon();
}

const MARKED = { collided: "bad", blocked: "bad", accepted: "good", removed: "offer", grabbed: "hand", released: "hand" };

function placeMarks() {
  $("scrub").max = timeline.newest;
  if (!looking()) $("scrub").value = timeline.shown;
  const marks = timeline.events.filter((event) => MARKED[event.kind]).slice(-200);
  const key = `${timeline.newest} ${marks.length}`;
  if ($("marks").dataset.key === key) return;
  $("marks").dataset.key = key;
  $("marks").replaceChildren(...marks.map((event) => {
    const made = element("i", MARKED[event.kind]);
    made.style.left = `${100 * event.frame / Math.max(timeline.newest, 1)}%`;
    made.title = `${event.time.toFixed(3)} s ${event.kind}: ${event.text}`;
    made.onclick = () => goTo(event);
    return made;
  }));
}

// The next event after the shown frame (before it, if `back`), around the end; of one kind if that is given.
function jump(back, kind) {
  const known = timeline.events.filter((event) => (kind ? event.kind === kind : MARKED[event.kind]));
  if (!known.length) return say(kind ? "no clash since the start" : "nothing has happened");
  const at = timeline.shown;
  const next = back ? known.filter((event) => event.frame < at).at(-1) ?? known.at(-1)
    : known.find((event) => event.frame > at) ?? known[0];
  goTo(next);
}

// Show the frame of an event, and of a clash its parts.
function goTo(event) {
  timeline.go(event.frame);
  const parts = event.kind === "collided" ? indicesOf(event.parts) : [];
  if (parts.length === 2 && parts.every((index) => index >= 0)) showPlace(parts, null);
}

$("earlier").onclick = () => jump(true);
$("later").onclick = () => jump(false);
$("to-clash").onclick = () => jump(false, "collided");

function lookBack(number) {
  const back = number < timeline.newest;
  timeline.back = back;
  $("status").textContent = back ? "looking back" : "";
  $("now").hidden = !back;
  if (timeline.waits) { timeline.asked = number; return; }
  timeline.waits = true;
  send({ action: "look", frame: back ? number : -1 });
  setTimeout(() => { // a frame that is not there is no answer
    timeline.waits = false;
    if (timeline.asked !== null) { const next = timeline.asked; timeline.asked = null; lookBack(next); }
  }, 40);
}

function live() {
  $("now").hidden = true;
  timeline.go = lookBack;
  $("scrub").oninput = () => lookBack(Number($("scrub").value));
  $("now").onclick = () => lookBack(timeline.newest);
  socket = new WebSocket(`ws://${location.host}/socket${location.search}`); // with the token
  const waiting = []; // messages after a frame that is not painted yet
  let received = 0, unpainted = false, unseen = null;
  const take = () => {
    while (waiting.length && !unpainted) {
      const message = waiting.shift();
      receive(message);
      received++;
      unpainted = message.type === "frame";
    }
    if (document.hidden) return drawn(); // timers of such a page may wait for a minute
    if (unseen !== null || received === 0) return;
    unseen = setTimeout(drawn, 200); // a page that nobody sees paints nothing
    requestAnimationFrame(drawn); // after `tick` has painted it
  };
  const drawn = () => {
    clearTimeout(unseen);
    unseen = null;
    for (; received > 0; received--) send({ action: "drawn" });
    unpainted = false;
    if (waiting.length) take();
  };
  socket.onmessage = (event) => {
    waiting.push(JSON.parse(event.data));
    take();
  };
  socket.onclose = () => {
    if ($("status").textContent !== ENDED) over("connection lost: reload the page");
    for (const made of document.querySelectorAll("#times button, #times input")) made.disabled = true;
  };
}

const ENDED = "session ended";

function over(words = ENDED) {
  tell(world.last);
  $("status").textContent = words;
  for (const made of document.querySelectorAll("#transport button, #constraints button, #hand button"))
    made.disabled = true; // what was can be looked at as long as it is served
}

function replay(messages) {
  $("pause").hidden = $("one").hidden = $("now").hidden = true;
  $("hand").hidden = true;
  const frames = [];
  for (const message of messages)
    if (message.type === "frame") frames.push({ ...frames.at(-1), ...message }); // what is not said is as it was
    else receive(message);
  if (frames.length < 2) $("times").hidden = true;
  if (!frames.length) return;
  if (frames.length > 1 && !WIDE.matches && window.innerWidth >= 600) openDrawer("left"); // Play is there
  frames.forEach((frame, number) => frame.events.forEach((event) => { event.frame = number; markEvent(event); }));
  const show = (index) => {
    world.trail.clear();
    $("events").replaceChildren();
    const past = frames.slice(0, index + 1).flatMap((frame) => frame.events);
    addEvents(past.slice(-60));
    for (const frame of frames.slice(0, index)) for (const [name, place] of Object.entries(frame.hands)) {
      const trail = world.trail.get(name) ?? [];
      trail.push(new THREE.Vector3(...place));
      world.trail.set(name, trail);
    }
    const moved = new Set(frames[index].moved);
    world.parts.forEach((part, i) => { if (!moved.has(i)) viewer.set_transform(part.path, part.pose); });
    timeline.shown = index;
    showFrame(frames[index]);
    $("trail").onchange();
  };
  timeline.newest = frames.length - 1;
  $("scrub").max = frames.length - 1;
  const stop = () => { playing = false; $("play").textContent = "Play"; };
  timeline.go = (index) => { stop(); $("scrub").value = index; show(index); tell(world.last); };
  $("scrub").oninput = () => timeline.go(Number($("scrub").value));
  let playing = false, origin = 0;
  const tick = () => {
    if (!playing) return;
    const now = performance.now() / 1e3 - origin;
    let index = Number($("scrub").value);
    while (index + 1 < frames.length && frames[index + 1].time <= now) index++;
    $("scrub").value = index;
    show(index);
    if (index + 1 < frames.length) requestAnimationFrame(tick);
    else stop();
  };
  $("play").onclick = () => {
    playing = !playing;
    $("play").textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    if (Number($("scrub").value) + 1 >= frames.length) $("scrub").value = 0;
    origin = performance.now() / 1e3 - frames[Number($("scrub").value)].time;
    requestAnimationFrame(tick);
  };
  const wanted = new URLSearchParams(location.search).get("step");
  const first = wanted === null ? frames.length - 1 : frames.findIndex((frame) => frame.step >= Number(wanted));
  $("scrub").value = Math.max(first, 0);
  show(Number($("scrub").value));
}
