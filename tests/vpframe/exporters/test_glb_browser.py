"""A GLB file in a browser: parsed as glTF 2.0 says, drawn with WebGL, and moved by its animation."""

import base64
import json

import numpy as np
import pytest

from tests.vpframe.browser import PROGRAM, Browser
from tests.vpframe.exporters.moving import model, moving

pytestmark = [pytest.mark.browser, pytest.mark.skipif(PROGRAM is None, reason="no Chromium on the PATH")]

VIEWER = """<!DOCTYPE html><canvas id=c width=300 height=300></canvas><script>
const bytes = Uint8Array.from(atob("GLB"), c => c.charCodeAt(0)), view = new DataView(bytes.buffer);
if (view.getUint32(0, true) !== 0x46546C67 || view.getUint32(4, true) !== 2) throw Error("no glTF 2.0");
if (view.getUint32(8, true) !== bytes.length) throw Error("length");
const size = view.getUint32(12, true), start = 20 + size + 8;
const doc = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + size)));
if (view.getUint32(20 + size, true) < doc.buffers[0].byteLength) throw Error("buffer");
const width = {SCALAR: 1, VEC3: 3, VEC4: 4};
function read(i) {
  const a = doc.accessors[i], v = doc.bufferViews[a.bufferView];
  const kind = a.componentType === 5125 ? Uint32Array : Float32Array;
  const from = start + v.byteOffset, count = a.count * width[a.type];
  if (v.byteOffset % 4 || count * 4 > v.byteLength || from + count * 4 > bytes.length) throw Error("accessor " + i);
  return new kind(bytes.slice(from, from + count * 4).buffer);
}
function product(a, b) {
  const out = new Array(16).fill(0);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) {
    out[4*c+r] += a[4*k+r] * b[4*c+k];
  }
  return out;
}
function placed([x, y, z] = [0, 0, 0], [i, j, k, w] = [0, 0, 0, 1]) {
  return [1-2*(j*j+k*k), 2*(i*j+k*w), 2*(i*k-j*w), 0, 2*(i*j-k*w), 1-2*(i*i+k*k), 2*(j*k+i*w), 0,
          2*(i*k+j*w), 2*(j*k-i*w), 1-2*(i*i+j*j), 0, x, y, z, 1];
}
function pose(time) {  // TRS of every node at a time, as the animation has it
  const trs = doc.nodes.map(n => ({translation: n.translation, rotation: n.rotation}));
  for (const c of doc.animations[0].channels) {
    const s = doc.animations[0].samplers[c.sampler], t = read(s.input), v = read(s.output), n = v.length / t.length;
    let k = 0; while (k < t.length - 2 && t[k + 1] <= time) k++;
    const u = Math.min(Math.max((time - t[k]) / (t[k + 1] - t[k]), 0), 1);
    trs[c.target.node][c.target.path] = Array.from({length: n}, (_, i) => (1 - u) * v[n*k+i] + u * v[n*(k+1)+i]);
  }
  const world = [];
  (function walk(i, above) {
    world[i] = product(above, placed(trs[i].translation, trs[i].rotation));
    for (const child of doc.nodes[i].children || []) walk(child, world[i]);
  })(0, placed());
  return world;
}
const gl = document.getElementById("c").getContext("webgl2", {preserveDrawingBuffer: true});
function shader(kind, text) {
  const s = gl.createShader(kind);
  gl.shaderSource(s, text); gl.compileShader(s);
  return s;
}
const program = gl.createProgram();
gl.attachShader(program, shader(gl.VERTEX_SHADER, `#version 300 es
  in vec3 p; uniform mat4 m; void main() { vec4 w = m * vec4(p, 1); gl_Position = vec4(w.xy / 4.0, w.z / 20.0, 1); }`));
gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `#version 300 es
  precision highp float; uniform vec4 c; out vec4 o; void main() { o = vec4(c.rgb, 1); }`));
gl.linkProgram(program); gl.useProgram(program); gl.enable(gl.DEPTH_TEST);
function draw(time) {
  gl.clearColor(0, 0, 0, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const world = pose(time);
  doc.nodes.forEach((node, i) => node.mesh === undefined || doc.meshes[node.mesh].primitives.forEach(p => {
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "m"), false, world[i]);
    gl.uniform4fv(gl.getUniformLocation(program, "c"), doc.materials[p.material].pbrMetallicRoughness.baseColorFactor);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, read(p.attributes.POSITION), gl.STATIC_DRAW);
    const at = gl.getAttribLocation(program, "p"); gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, read(p.indices), gl.STATIC_DRAW);
    gl.drawElements(gl.TRIANGLES, doc.accessors[p.indices].count, gl.UNSIGNED_INT, 0);
  }));
  const pixels = new Uint8Array(4 * 300 * 300); gl.readPixels(0, 0, 300, 300, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let lit = 0, sum = 0;
  pixels.forEach((v, k) => { if (k % 4 < 3 && v) { lit++; sum = (sum * 31 + v * k) % 1000003; } });
  const named = doc.nodes.flatMap((n, i) => n.extras ? [[n.extras.path, world[i].slice(12, 15)]] : []);
  const where = Object.fromEntries(named);
  return {lit, sum, where, error: gl.getError()};
}
</script>"""


def test_a_browser_draws_a_glb_upright_and_plays_its_motion(tmp_path):
    scene = model()
    motion = moving(scene)
    scene.export(tmp_path / "out.glb", motion)
    page = VIEWER.replace("GLB", base64.b64encode((tmp_path / "out.glb").read_bytes()).decode())
    (tmp_path / "page.html").write_text(page)
    with Browser(320, 320) as browser:
        browser.open((tmp_path / "page.html").as_uri())
        first, last = (json.loads(browser.run(f"JSON.stringify(draw({t}))")) for t in (0.0, 1.5))
        assert browser.errors == []
    for drawn, t in ((first, 0.0), (last, 1.5)):
        assert drawn["error"] == 0 and drawn["lit"] > 20
        for name, pose in motion.at(t).items():
            x, y, z = pose.translation  # z up is y up there
            assert np.abs(np.array(drawn["where"][name]) - [x, z, -y]).max() < 1e-6
    assert first["sum"] != last["sum"]
