// The explorer's page in a frame of its own, so that neither styles the other: the scene goes in,
// each change comes out.
function render({ model, el }) {
  const frame = document.createElement("iframe");
  frame.title = "gramian explorer";
  frame.allow = "clipboard-write";
  frame.style.cssText = `width: 100%; height: ${model.get("_height")}px; border: 0; border-radius: 8px;`;
  frame.srcdoc = model.get("_page");
  const open = () => frame.contentWindow.postMessage({ gramian: "open", ...model.get("_opened") }, "*");
  const hear = ({ source, data }) => {
    if (source !== frame.contentWindow || !data) return;
    if (data.gramian === "ready") open();
    if (data.gramian === "scene") {
      const { tab, scene, toml, status } = data;
      model.set("now", { tab, scene, toml, status });
      model.save_changes();
    }
  };
  window.addEventListener("message", hear);
  model.on("change:_opened", open);
  el.append(frame);
  return () => { window.removeEventListener("message", hear); model.off("change:_opened", open); };
}
export default { render };
