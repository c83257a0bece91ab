//! What the host wants to see.

use super::OUTPUT;
use super::canvas::Canvas;
use crate::error::{Error, Result};
use crate::host::names::*;
use crate::host::{Call, Properties, Rect, Reply};

/// One call of the action Render.
pub struct Request {
    /// The frame.
    pub time: f64,
    /// Pixels across and up for one at full scale.
    pub scale: (f64, f64),
    /// `None` asks for the whole output.
    pub window: Option<Rect<i32>>,
    field: Option<String>,
}

impl Request {
    fn read(args: Properties<'_>) -> Result<Self> {
        let [x, y] = args.doubles(kOfxImageEffectPropRenderScale).unwrap_or([1.0, 1.0]);
        if !(x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite()) {
            return Err(Error::host(format!("asks for a render scale of {x} by {y}")));
        }
        Ok(Self {
            time: args.double(kOfxPropTime, 0).unwrap_or_default(),
            scale: (x, y),
            window: args.ints(kOfxImageEffectPropRenderWindow).map(|[x1, y1, x2, y2]| Rect { x1, y1, x2, y2 }),
            field: args.string(kOfxImageEffectPropFieldToRender, 0),
        })
    }

    /// Whole frames only; "both" is what progressive hosts say now and then.
    fn refuse_fields(&self) -> Result<()> {
        let single = [kOfxImageFieldLower, kOfxImageFieldUpper];
        match &self.field {
            Some(field) if single.iter().any(|f| f.to_bytes() == field.as_bytes()) => Err(Error::Host {
                what: "asks for a single field".to_owned(),
                advice: "set the project or the clip to progressive frames",
            }),
            _ => Ok(()),
        }
    }
}

/// Renders with `draw`, and shows or clears the message. A render that fails, is stopped or panics leaves the window cleared:
/// some hosts show the buffer whatever we answer.
pub fn render(call: &Call<'_>, draw: impl FnOnce(&Request, &mut Canvas<'_>) -> Result<()>) -> Reply {
    let picture = || {
        let request = Request::read(call.args.ok_or_else(|| Error::host("gave no arguments to render"))?)?;
        let output = call.effect.clip(OUTPUT).map_or(Ok(None), |clip| clip.image(request.time))?;
        let mut canvas = Canvas::new(output.ok_or_else(|| Error::host("gave no output image"))?, request.window);
        request.refuse_fields()?;
        draw(&request, &mut canvas)
    };
    match picture() {
        Ok(()) => {
            call.effect.clear_error();
            Reply::Ok
        }
        // The host asked to stop and throws the picture away; it did not fail.
        Err(Error::Aborted) => Reply::Ok,
        Err(error) => {
            call.effect.show_error(&error.to_string());
            Reply::Failed
        }
    }
}
