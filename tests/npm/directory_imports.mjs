// @oarc/gpp-access is built for bundlers, which find './request' as './request/index.js' and './Sensor' as
// './Sensor.js'; Node does not by itself. Used with `node --import`.
import { register } from 'node:module';

const hooks = `
export async function resolve(specifier, context, next) {
  if (!specifier.startsWith('.') || specifier.endsWith('.js')) return next(specifier, context);
  for (const end of ['.js', '/index.js']) {
    try { return await next(specifier + end, context); } catch (error) { if (error.code !== 'ERR_MODULE_NOT_FOUND') throw error; }
  }
  return next(specifier, context);
}`;
register('data:text/javascript,' + encodeURIComponent(hooks));
