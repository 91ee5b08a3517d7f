/* Keeps the files of the page, so that it opens without a network after one visit. A file is taken from the network as
 * long as there is one: what is kept is never older than the last visit. */
const KEPT = "rrrgen-playground";

addEventListener("install", (event) => {
  skipWaiting();
  event.waitUntil(keepAll());
});
addEventListener("activate", (event) => event.waitUntil(clients.claim()));
addEventListener("fetch", (event) => {
  if (event.request.method === "GET" && new URL(event.request.url).origin === location.origin) event.respondWith(answer(event.request));
});

async function keepAll() {
  const files = await (await fetch("files.json")).json();
  await (await caches.open(KEPT)).addAll(["./", ...files]);
}

async function answer(request) {
  const kept = await caches.open(KEPT);
  try {
    const response = await fetch(request);
    if (response.ok) await kept.put(request, response.clone());
    return response;
  } catch (error) {
    const earlier = await kept.match(request);
    if (earlier) return earlier;
    throw error;
  }
}
