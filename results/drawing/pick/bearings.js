// Directions as people say them: the page's twin of models/bearings.py.
const WINDS = ["N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW"];
const turned = degrees => ((degrees % 360) + 360) % 360;

// Azimuth, degrees counter-clockwise from east, of a bearing or of such degrees; null of anything else.
export function azimuthOf(text) {
  const said = text.trim().replace(/°$/, "").toUpperCase(), compass = /^COMPASS:\s*(\d+(?:\.\d*)?)$/.exec(said);
  const quadrant = /^([NS])\s*(\d+(?:\.\d*)?)\s*°?\s*([EW])$/.exec(said);
  if (compass) return +compass[1] <= 360 ? turned(90 - compass[1]) : null;
  if (quadrant) {
    const away = +quadrant[2], half = quadrant[1] === "N" ? away : 180 - away;
    return away > 90 ? null : turned(90 - (quadrant[3] === "E" ? half : -half));
  }
  if (WINDS.includes(said)) return turned(90 - 22.5 * WINDS.indexOf(said));
  return said !== "" && Number.isFinite(+said) && Math.abs(+said) <= 360 ? turned(+said) : null;
}

// A quadrant bearing of an azimuth, to so many decimals, or one of four winds.
export function bearingOf(azimuth, decimals = 0) {
  const bearing = turned(+(90 - azimuth).toFixed(decimals)), north = bearing < 90 || bearing > 270;
  if (bearing % 90 === 0) return WINDS[bearing / 90 * 4];
  const away = north ? Math.min(bearing, 360 - bearing) : Math.abs(180 - bearing);
  return `${north ? "N" : "S"}${+away.toFixed(decimals)}${bearing < 180 ? "E" : "W"}`;
}
