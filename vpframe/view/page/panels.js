// ---- the panels ----------------------------------------------------------------------------------------------------

function showHeld(frame) {
  // a part that the page's hand has let go is still held in the last frame
  const held = desk.type ? desk.held.map((index) => world.parts[index].name) : frame.held;
  const rows = Object.entries(frame.freedom).map(([name, [freedom, joint]]) => {
    const row = element("div", "row");
    row.append(element("span", "what", shortName(name) + (held.includes(name) ? " (in hand)" : "")),
      element("span", "dim", `${joint} · ${freedom}`));
    return row;
  });
  if (frame.clearance !== null) {
    const row = element("div", "row");
    row.append(element("span", "what", "clearance"), element("span", "dim", `${(1e3 * frame.clearance).toFixed(3)} mm`));
    rows.push(row);
  }
  rows.forEach((row, k) => { row.title = Object.keys(frame.freedom)[k] ?? ""; });
  $("held").replaceChildren(...(rows.length ? rows : [element("span", "empty", "none")]));
}

// Indices of the parts that are not where they were as the assembly stood.
function elsewhere() {
  if (!world.last) return new Set();
  const poses = floats(world.last.poses);
  return new Set(world.last.moved.filter((index, i) =>
    world.parts[index].pose.some((value, k) => Math.fround(value) !== poses[16 * i + k])));
}

// Clashes by pair of parts: those in depth that were found of the assembly as it stood, while neither part has moved;
// of all others the surfaces that meet now.
function clashPairs() {
  const rows = world.last ? world.last.colliding : [], found = world.found && world.found.done ? world.found.rows : null;
  const moved = elsewhere();
  const pairs = new Map();
  for (const [a, s, b, t] of rows) {
    if (found && !moved.has(a) && !moved.has(b)) continue;
    const key = `${a} ${b}`, known = pairs.get(key);
    if (known) known.count++;
    else pairs.set(key, { parts: [a, b], surfaces: [s, t], count: 1, depth: null, at: null });
  }
  return [...(found ?? []).filter((row) => !row.parts.some((index) => moved.has(index))), ...pairs.values()];
}

function showFound(message) {
  world.found = message;
  $("clash-note").textContent = message.done ? message.text : `still looking: ${message.text}`;
  showClashes();
}

// ---- lists: names as short as they are distinct, rows of one pattern as one, a filter

const PATTERN = /[\s_.:#-]*\(?\d+\)?$/; // the number of an instance at the end of a name
const patternOf = (name) => { let rest = name; while (rest !== (rest = rest.replace(PATTERN, "") || rest)); return rest; };
const unfolded = new Set(); // groups that a person has unfolded

function isListed(parts, words) {
  const search = $("search").value.trim().toLowerCase();
  if ($("only-selected").checked && selection.parts.length && !parts.some((index) => selection.parts.includes(world.parts[index]))) return false;
  return !search || `${words} ${parts.map((index) => world.parts[index].name).join(" ")}`.toLowerCase().includes(search);
}

// A row that lights its parts, and flies to them when it is pressed.
function listRow(color, text, title, parts, act) {
  const row = element("div", "row"), dot = element("span", "dot"), what = element("span", "what place", text);
  dot.style.background = color;
  what.title = title;
  Object.assign(what, { tabIndex: 0, onclick: act });
  what.setAttribute("role", "button");
  what.onkeydown = (event) => {
    if (event.key === "Enter") return act();
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const all = [...row.closest(".list").querySelectorAll(".what")].filter((other) => other.offsetParent);
    all[all.indexOf(what) + step]?.focus();
  };
  let ends = [];
  row.onmouseenter = what.onfocus = () => {
    ends.forEach((end) => end());
    ends = parts.map((index) => world.parts[index]).filter((part) => isShown(part) && !selection.parts.includes(part)).map((part) => outline(part, HOVER));
    viewer.set_dirty();
  };
  row.onmouseleave = what.onblur = () => { ends.forEach((end) => end()); ends = []; viewer.set_dirty(); };
  row.append(dot, what);
  return row;
}

// Rows {key, make} of one key under one row that folds them: "8 × concentric: bolt – plate".
function showList(list, entries, words) {
  const groups = new Map();
  for (const entry of entries) groups.set(entry.key, [...(groups.get(entry.key) ?? []), entry]);
  list.replaceChildren(...[...groups].flatMap(([key, alike]) => {
    if (alike.length < 3) return alike.map((entry) => entry.make());
    const rest = element("div", "more"), parts = [...new Set(alike.flatMap((entry) => entry.parts))];
    const open = () => {
      unfolded[rest.hidden ? "add" : "delete"](key);
      rest.hidden = !rest.hidden;
      if (!rest.childElementCount) rest.append(...alike.map((entry) => entry.make()));
    };
    const head = listRow(alike[0].color, `${alike.length} × ${alike[0].pattern}`, "show each", parts, open);
    rest.hidden = true;
    if (unfolded.has(key)) open();
    return [head, rest];
  }));
  if (!entries.length && words) list.replaceChildren(element("span", "dim", words));
}

function showClashes() {
  const looking = world.found && !world.found.done, pairs = clashPairs(); // while looking, 0 is not known yet
  const known = looking ? pairs.length > 0 : Boolean(world.last || world.found);
  $("clash-count").textContent = known ? `${pairs.length}${looking ? " …" : ""}` : "–";
  if (world.last && !world.found) $("clash-note").textContent = "";
  const signature = JSON.stringify([pairs, filterOf()]);
  if ($("clashes").dataset.signature === signature) return;
  $("clashes").dataset.signature = signature;
  const listed = pairs.filter(({ parts }) => isListed(parts, "clash"));
  showList($("clashes"), listed.slice(0, 500).map(({ parts, surfaces, count, depth, at }) => {
    const names = parts.map((index) => world.parts[index].short), color = world.info.colors.colliding;
    const faces = surfaces.length ? parts.map((index, k) => faceName(world.parts[index], surfaces[k])) : parts.map((index) => world.parts[index].name);
    const pattern = names.map(patternOf).join(" – ");
    return { key: pattern, pattern, color, parts, make: () => {
      const row = listRow(color, names.join(" – "), faces.join(" – "), parts, () => showPlace(parts, at, faces));
      if (depth) row.append(element("span", "dim", mm(Number(depth.toPrecision(3)))));
      else if (count > 1) row.append(element("span", "dim", `${count} pairs of faces`));
      return row;
    } };
  }), pairs.length ? "none that is asked for" : "");
}

function showConstraints(list) {
  $("constraint-count").textContent = list.length;
  const signature = JSON.stringify([list.map((c) => [c.id, c.state]), filterOf()]);
  if ($("constraints").dataset.signature === signature) return; // buttons must not be replaced under the pointer
  $("constraints").dataset.signature = signature;
  const all = list.map((c) => ({ c, parts: indicesOf(c.parts) }));
  showList($("constraints"), all.filter(({ c, parts }) => isListed(parts, `${c.kind} ${c.state}`)).map(({ c, parts }) => {
    const names = parts.map((index) => world.parts[index].short), color = world.info.colors.state[c.state];
    const pattern = `${c.kind}: ${names.map(patternOf).join(" – ")}`;
    return { key: `${pattern} ${c.state} ${c.state === "candidate" ? c.id : ""}`, pattern, color, parts, make: () => {
      const faces = parts.map((index, k) => (c.surfaces[k].length ? faceName(world.parts[index], c.surfaces[k][0]) : c.parts[k]));
      const row = listRow(color, `${c.kind}: ${names.join(" – ")}`,
        `${c.parts.join(" – ")}: ${c.state}, off by ${(1e3 * c.residual).toPrecision(2)} mm. ${c.why}`, parts, () => showPlace(parts, c.at, faces));
      row.dataset.id = c.id;
      if (!socket) row.append(element("span", "dim", c.state));
      else {
        if (c.state === "refused") row.append(element("span", "dim", "refused"));
        if (c.state !== "active") row.append(button("Accept", { action: "accept", id: c.id }));
        if (c.state === "candidate") row.append(button("Refuse", { action: "refuse", id: c.id }));
        if (c.state === "active") row.append(button("Remove", { action: "remove", id: c.id }));
      }
      return row;
    } };
  }), list.length ? "none that is asked for" : "");
}

const filterOf = () => [$("search").value, $("only-selected").checked && selection.parts.map((part) => part.index)];

function showLists() {
  showClashes();
  if (world.last) showConstraints(world.last.constraints);
}

$("search").oninput = $("only-selected").onchange = showLists;

function button(text, message) {
  const made = element("button", "", text);
  made.onclick = () => { made.disabled = true; send(message); };
  return made;
}

function addEvents(events) {
  if (!events.length) return;
  $("events").append(...events.slice(-300).map((event) => {
    const line = element("div", event.tone);
    if (event.frame !== null) {
      line.classList.add("place");
      line.onclick = () => goTo(event);
    }
    line.append(element("span", "at", `${event.time.toFixed(3)} s`), element("span", "kind", event.kind),
      document.createTextNode(event.text));
    return line;
  }));
  while ($("events").childElementCount > 300) $("events").firstChild.remove();
  $("events").parentElement.scrollTop = 1e9;
}

$("unfold").onclick = () => {
  $("unfold").textContent = document.querySelector("footer").classList.toggle("open") ? "▾" : "▴";
  $("events").parentElement.scrollTop = 1e9;
};

let silence = 0;

function say(text) {
  $("say").textContent = text;
  $("say").hidden = false;
  clearTimeout(silence);
  silence = setTimeout(() => { $("say").hidden = true; }, 6000);
}

function send(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}
