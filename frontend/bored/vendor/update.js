// Copies what the page needs from elsewhere: Leaflet (npm install) and Shepherd's own client. `npm run vendor`.
import { copyFileSync, readFileSync, writeFileSync } from "node:fs";

const here = new URL("./", import.meta.url);
const leaflet = new URL("../node_modules/leaflet/", here);

const code = readFileSync(new URL("dist/leaflet.js", leaflet), "utf8");
writeFileSync(new URL("leaflet/leaflet.js", here), code.replace(/^\/\/# sourceMappingURL.*\n?/m, ""));
copyFileSync(new URL("dist/leaflet.css", leaflet), new URL("leaflet/leaflet.css", here));
copyFileSync(new URL("LICENSE", leaflet), new URL("leaflet/LICENSE", here));
for (const name of ["shepherd-client.js", "shepherd-client.d.ts"]) {
  copyFileSync(new URL(`../../../clients/javascript/${name}`, here), new URL(name, here));
}
