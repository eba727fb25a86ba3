// ---- the panels ----------------------------------------------------------------------------------------------------

function showHeld(frame) {
  const rows = Object.entries(frame.freedom).map(([name, [freedom, joint]]) => {
    const row = element("div", "row");
    row.append(element("span", "what", name + (frame.held.includes(name) ? " (in hand)" : "")),
      element("span", "dim", `${joint} · ${freedom}`));
    return row;
  });
  if (frame.clearance !== null) {
    const row = element("div", "row");
    row.append(element("span", "what", "clearance"), element("span", "dim", `${(1e3 * frame.clearance).toFixed(3)} mm`));
    rows.push(row);
  }
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

function showClashes() {
  const looked = Boolean(world.last || (world.found && world.found.done)), pairs = clashPairs();
  $("clash-count").textContent = looked ? pairs.length : "–";
  if (looked && !world.found) $("clash-note").textContent = "";
  const signature = JSON.stringify(pairs);
  if ($("clashes").dataset.signature === signature) return;
  $("clashes").dataset.signature = signature;
  $("clashes").replaceChildren(...pairs.slice(0, 200).map(({ parts, surfaces, count, depth, at }) => {
    const row = element("div", "row place");
    const dot = element("span", "dot");
    dot.style.background = world.info.colors.colliding;
    const names = parts.map((index) => world.parts[index].name);
    const faces = surfaces.length ? parts.map((index, k) => faceName(world.parts[index], surfaces[k])) : names;
    const what = element("span", "what", names.join(" – "));
    what.title = faces.join(" – ");
    row.append(dot, what);
    if (depth) row.append(element("span", "dim", mm(Number(depth.toPrecision(3)))));
    else if (count > 1) row.append(element("span", "dim", `${count} pairs of faces`));
    row.onclick = () => showPlace(parts, at, faces);
    return row;
  }));
}

function showConstraints(list) {
  $("constraint-count").textContent = list.length;
  const signature = JSON.stringify(list.map((c) => [c.id, c.state]));
  if ($("constraints").dataset.signature === signature) return; // buttons must not be replaced under the pointer
  $("constraints").dataset.signature = signature;
  $("constraints").replaceChildren(...list.map((c) => {
    const row = element("div", "row");
    row.dataset.id = c.id;
    const dot = element("span", "dot");
    dot.style.background = world.info.colors.state[c.state];
    const what = element("span", "what", `${c.kind}: ${c.parts[0]} – ${c.parts[1]}`);
    what.title = `${c.state}, off by ${(1e3 * c.residual).toPrecision(2)} mm. ${c.why}`;
    row.append(dot, what);
    what.classList.add("place");
    what.onclick = () => {
      const parts = indicesOf(c.parts);
      const faces = parts.map((index, k) => (c.surfaces[k].length ? faceName(world.parts[index], c.surfaces[k][0]) : c.parts[k]));
      showPlace(parts, c.at, faces);
    };
    if (socket) {
      if (c.state === "refused") row.append(element("span", "dim", "refused"));
      if (c.state !== "active") row.append(button("Accept", { action: "accept", id: c.id }));
      if (c.state === "candidate") row.append(button("Refuse", { action: "refuse", id: c.id }));
      if (c.state === "active") row.append(button("Remove", { action: "remove", id: c.id }));
    } else row.append(element("span", "dim", c.state));
    return row;
  }));
}

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
