//! What is known of a picture before it is drawn: about how bright it is, which makes its goal, and
//! whether bounds of its pixels' areas can be brought within that.

use super::{FIRST_TRY, Renderer, Round, into_inner, lock, worst};
use crate::Result;
use crate::cache::Header;
use crate::render::camera::rays::PixelGrid;
use crate::render::camera::view::View;
use crate::render::plan::cut::{Cut, FootprintCut};
use crate::render::plan::effort::Effort;
use crate::render::plan::goal::{Goal, Method, power};
use crate::render::transfer::pieces::TransferPieces;
use crate::render::{EXACT, largest_value};
use crate::scene::{Samples, Scene, Tolerance};

/// A glance is at most this many pixels wide or high, or rays where it has fewer pixels; and at least so
/// many where it is half as wide as a small picture.
const GLANCE_PIXELS: u32 = 64;
const LEAST_GLANCE_PIXELS: u32 = 16;
/// A glance that saw less than one part in so many of what rays meet was misled by means; and what these
/// rays may be off by, as a part of it.
const MISLED: f64 = 4.0;
const ROUGHLY: f64 = 0.25;
/// Rays for each pixel, of either kind, where no glance has seen anything.
const SKETCH_RAYS: u64 = 16;
/// What counts of what single or few rays have met: the mean of a pixel may be less.
const OF_RAYS: f64 = 0.5;
/// Pixels along an edge that an outlook is taken from: few, which mostly say that areas are out of
/// reach, then enough for an average, and not enough to meet all bricks of a large set.
const OUTLOOKS: [u32; 2] = [8, 24];
/// The rays for each of them: one and its quarters, each marched again and again through finer levels.
const OUTLOOK_RAYS: u64 = 64;
/// Few pixels that need this many times the rays that bounds are worth say so for all.
const FAR_OUT: f64 = 4.0;
/// What is sure of the picture's largest value is less by what it may be off by itself: the part of the
/// tolerance that is tried allows for that, and for a little more.
const SURE: f64 = 0.97;

/// How bounds of pixels' areas will fall, by a few pixels.
struct Outlook {
    /// How many rays pixels need on average.
    rays_needed: f64,
    /// The power of the number of rays that bounds fall with.
    power: f64,
    /// Whether no pixel needs more rays than any may take.
    is_within_reach: bool,
}

impl Renderer<'_> {
    /// The goal by glances, before anything is known of pixels' areas.
    pub(super) fn first_goal(
        &self,
        pixels: &PixelGrid,
        effort: &Effort,
        is_exact: bool,
    ) -> Result<Goal> {
        let glance = if is_exact && !pixels.has_area() { 0.0 } else { self.glance()? };
        let goal = self.goal_for(glance, effort, is_exact);
        if is_exact || !pixels.has_area() {
            return Ok(goal);
        }
        // Areas take many rays where the goal is too small.
        let rays =
            if glance > 0.0 { self.second_glance(&goal)? } else { self.sketch(pixels, &goal)? };
        let is_misled = rays > MISLED * glance;
        Ok(if is_misled { self.goal_for(OF_RAYS * rays, effort, is_exact) } else { goal })
    }

    fn goal_for(&self, glance: f64, effort: &Effort, is_exact: bool) -> Goal {
        Goal {
            tolerance: match self.scene.render.tolerance {
                _ if is_exact => EXACT * glance,
                Tolerance::Absolute(value) => value,
                Tolerance::Relative(part) if glance > 0.0 => {
                    FIRST_TRY.min(SURE / (1.0 + part)) * part * glance
                }
                Tolerance::Relative(_) => f64::MIN_POSITIVE,
            },
            behind: glance,
            rays_per_pixel: effort.most,
            scouting_per_pixel: effort.scouting,
            alone_per_pixel: effort.most_alone,
            most_halvings: u8::MAX,
            least_halvings: effort.least_halvings,
            glint_halvings: effort.glint_halvings,
            certifies: true,
            trusts_rays: false,
            power: f64::INFINITY,
            has_area: self.scene.render.samples == Samples::Area,
            all_levels: is_exact,
            sounds: false,
        }
    }

    /// The largest value of a small picture, drawn without regard to its error: of fewer rays first where
    /// the picture's own are few.
    pub(super) fn glance(&self) -> Result<f64> {
        let image = &self.scene.image;
        let half = image.width.max(image.height).div_ceil(2).max(LEAST_GLANCE_PIXELS);
        if half < GLANCE_PIXELS && self.scene.render.samples != Samples::Area {
            let largest = self.glance_within(half)?;
            if largest > 0.0 {
                return Ok(largest);
            }
        }
        self.glance_within(GLANCE_PIXELS)
    }

    /// The same of a picture of at most so many pixels, or rays, along an edge: through cells as wide as
    /// its pixels, and if these show nothing through all levels. What shines may do so at values that no
    /// mean has.
    fn glance_within(&self, most: u32) -> Result<f64> {
        let (scene, _) = self.small(most);
        let view = View::new(&scene, &self.cache.header().domain)?;
        let most = (most / scene.image.width.max(scene.image.height)).max(1);
        let rays = match self.scene.render.samples {
            Samples::Grid(rays) => rays.min(most),
            Samples::Area => most,
        };
        let pixels = PixelGrid::new(&view, Samples::Grid(rays));
        let Header { domain, shape, .. } = self.cache.header();
        let wide = FootprintCut::new(f64::from(rays).recip(), &scene, domain, *shape)?;
        let largest = self.glance_through(Cut::Footprint(wide.in_short()), &pixels)?;
        if largest > 0.0 { Ok(largest) } else { self.glance_through(Cut::FullDepth, &pixels) }
    }

    fn glance_through(&self, cut: Cut, pixels: &PixelGrid) -> Result<f64> {
        let method = Method::Once { cut, accounts: false };
        let mut picture = self.picture(pixels, self.exact, method, None, None)?;
        picture.light.packets = Some(self.packets(None, 0.0));
        picture.draw(self.threads, self.plan.readers, &Round::WHOLE, &mut [])?;
        largest_value(&into_inner(picture.film))
    }

    /// The largest value of a small picture of single rays that are roughly right.
    fn second_glance(&self, goal: &Goal) -> Result<f64> {
        let (scene, _) = self.small(GLANCE_PIXELS);
        let view = View::new(&scene, &self.cache.header().domain)?;
        let pixels = PixelGrid::new(&view, Samples::Grid(1));
        let goal = Goal { tolerance: ROUGHLY * goal.behind, ..*goal };
        self.draw_for(goal, Some(ROUGHLY), &pixels)
    }

    /// The largest value of the picture by few rays a pixel, where no glance has seen anything: with
    /// nothing to expect all that may be there would be worth every ray.
    fn sketch(&self, pixels: &PixelGrid, goal: &Goal) -> Result<f64> {
        let few = |rays: u64| rays.min(SKETCH_RAYS);
        let (rays_per_pixel, alone_per_pixel) =
            (few(goal.rays_per_pixel), few(goal.alone_per_pixel));
        self.draw_for(Goal { rays_per_pixel, alone_per_pixel, ..*goal }, None, pixels)
    }

    /// The largest value of what is drawn for a goal, or for `part` of that.
    fn draw_for(&self, mut goal: Goal, part: Option<f64>, pixels: &PixelGrid) -> Result<f64> {
        let transfer = self.transfer(goal.tolerance);
        let method = Method::Within(goal);
        let mut picture = self.picture(pixels, &transfer, method, Some(goal.tolerance), None)?;
        picture.light.packets = Some(self.packets_for(&goal));
        self.draw_within(&mut picture, &mut goal, part, &mut [])?;
        largest_value(&into_inner(picture.film))
    }

    /// Decides whether pixels' areas are to be certified, and how many rays that may take.
    pub(super) fn look_out(
        &self,
        goal: &mut Goal,
        effort: &Effort,
        transfer: &TransferPieces,
    ) -> Result<()> {
        let size = self.scene.image.width.max(self.scene.image.height);
        let [few, enough] = OUTLOOKS;
        let worthwhile = effort.worthwhile as f64;
        for pixels in [few, enough].into_iter().filter(|&n| n == enough || 2 * n <= size) {
            let outlook = self.outlook(pixels, goal, transfer)?;
            goal.power = outlook.power;
            goal.certifies = outlook.is_within_reach && outlook.rays_needed <= worthwhile;
            if !outlook.is_within_reach || outlook.rays_needed > FAR_OUT * worthwhile {
                break;
            }
        }
        if goal.certifies {
            goal.rays_per_pixel = effort.most_certified;
        } else {
            goal.give_up_certificates();
        }
        Ok(())
    }

    /// What a few pixels, quartered once, say of how bounds of pixels' areas will fall: so many along
    /// an edge, no more than a tile has.
    fn outlook(&self, pixels: u32, goal: &Goal, transfer: &TransferPieces) -> Result<Outlook> {
        let (scene, part) = self.small(pixels);
        let view = View::new(&scene, &self.cache.header().domain)?;
        let pixels = PixelGrid::sparse(&view, part);
        let quartered = Goal {
            rays_per_pixel: OUTLOOK_RAYS,
            scouting_per_pixel: OUTLOOK_RAYS,
            alone_per_pixel: 1,
            most_halvings: 1,
            certifies: true,
            power: f64::INFINITY,
            // Most pictures that are large are not certified: these read no bricks in vain then.
            ..goal.trusting_rays()
        };
        let mut picture =
            self.picture(&pixels, transfer, Method::Within(quartered), Some(goal.tolerance), None)?;
        picture.light.packets = Some(self.packets_for(goal));
        picture.draw(self.threads, self.plan.readers, &Round::WHOLE, &mut [])?;
        let all = worst(&lock(&picture.errors));
        Ok(Outlook {
            rays_needed: all.rays_needed / (f64::from(view.width()) * f64::from(view.height())),
            power: power(all.fallen).unwrap_or(1.0),
            is_within_reach: all.beyond == 0,
        })
    }

    /// The scene, in a picture of at most so many pixels along an edge, and how wide its own pixels are
    /// in that.
    fn small(&self, pixels: u32) -> (Scene, f64) {
        let image = &self.scene.image;
        let scale = f64::from(pixels) / f64::from(image.width.max(image.height));
        let mut scene = self.scene.clone();
        if scale >= 1.0 {
            return (scene, 1.0);
        }
        let scaled = |size: u32| ((f64::from(size) * scale).round() as u32).max(1);
        (scene.image.width, scene.image.height) = (scaled(image.width), scaled(image.height));
        (scene, scale)
    }
}
