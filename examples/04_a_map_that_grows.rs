//! A picture that moves: `cargo run --release --example 04_a_map_that_grows [LOG]`.
//!
//! Maps a log, or a simulated drive where none is given, and draws the walls and the path of the best particle while they grow, as an
//! animated PNG: `growing.png`. Where a loop is closed, the map is seen to move.

use image::{Rgb, RgbImage};
use ipslam::config::SlamConfig;
use ipslam::geometry::StampedPose;
use ipslam::io::mcap::Topics;
use ipslam::io::{open_log, write_whole};
use ipslam::log::LogSource;
use ipslam::picture::{Line, Picture, View, svg_to_png};
use ipslam::ppca::Cluster;
use ipslam::report::{Estimator as _, Event, RunResult};
use ipslam::simulate::Simulation;
use ipslam::slam::Slam;
use png::{BlendOp, ColorType, Compression, Encoder, EncodingError, Filter};
use std::error::Error;
use std::path::Path;

/// Pictures of the map while it grows.
const PICTURES: usize = 30;
/// Longer side \[pixels\].
const SIDE: u32 = 700;
/// How long a picture stays, and the finished map \[tenths of a second\].
const EACH: u16 = 2;
const FINISHED: u16 = 30;

/// What the filter holds for the best map at one step.
struct Moment {
    walls: Vec<Cluster>,
    path: Vec<StampedPose>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let log: Box<dyn LogSource> = match std::env::args_os().nth(1) {
        Some(path) => open_log(path, &Topics::default())?,
        None => Box::new(Simulation::building(1)),
    };
    let config = SlamConfig { particles: 32, maps: 32, ..SlamConfig::default() };

    let (moments, mut result) = grow(&*log, config)?;
    config.smoother().smooth(&*log, &mut result, &mut |_| {})?;
    let finished = Moment { walls: result.map.clusters.clone(), path: result.trajectory() };
    let view = View::around([finished.path.as_slice()], &finished.walls, None);

    let chosen = (1..=PICTURES).filter_map(|number| moments.get((number * moments.len() / PICTURES).checked_sub(1)?));
    // Whoever shows no animation shows the first picture.
    let pictures: Vec<RgbImage> = [&finished]
        .into_iter()
        .chain(chosen)
        .map(|moment| draw(moment, view, &log.name()))
        .collect::<Result<_, _>>()?;
    let file = animate(&pictures)?;
    write_whole(Path::new("growing.png"), |to| to.write_all(&file))?;
    println!("growing.png is written: {} pictures, {} kB", pictures.len(), file.len() / 1000);
    Ok(())
}

/// The map at every step of the filter, and what it ends with.
fn grow(log: &dyn LogSource, config: SlamConfig) -> Result<(Vec<Moment>, RunResult), Box<dyn Error>> {
    let mut slam = Slam::new(config);
    let mut moments = Vec::new();
    for entry in log.open()? {
        let mut walls = None;
        slam.add(&entry?, &mut |event| {
            if let Event::Step(step) = event {
                walls = Some(step.map.to_vec());
            }
        });
        if let Some(walls) = walls {
            let path = slam.path().into_iter().map(|pose| StampedPose { stamp: 0.0, pose }).collect();
            moments.push(Moment { walls, path });
        }
    }
    Ok((moments, slam.result()))
}

fn draw(moment: &Moment, view: View, name: &str) -> Result<RgbImage, Box<dyn Error>> {
    let picture = Picture::new(name)
        .note(format!("{} walls", moment.walls.len()))
        .view(view)
        .trajectory("path of the robot", Line::ESTIMATE, &moment.path)
        .clusters(&moment.walls);
    let png = svg_to_png(&picture.to_svg(), SIDE)?;
    Ok(image::load_from_memory(&png)?.to_rgb8())
}

/// The bytes of an animated PNG, in which every picture but the first holds only what has changed.
fn animate(pictures: &[RgbImage]) -> Result<Vec<u8>, EncodingError> {
    let mut file = Vec::new();
    let (width, height) = pictures[0].dimensions();
    let mut encoder = Encoder::new(&mut file, width, height);
    encoder.set_color(ColorType::Rgba);
    encoder.set_compression(Compression::High);
    encoder.set_filter(Filter::NoFilter);
    encoder.set_animated(pictures.len() as u32, 0)?;
    encoder.set_blend_op(BlendOp::Over)?;
    encoder.set_frame_delay(FINISHED, 10)?;
    let mut writer = encoder.write_header()?;
    let mut before: Option<&RgbImage> = None;
    for picture in pictures {
        if before.is_some() {
            writer.set_frame_delay(EACH, 10)?;
        }
        let changed = picture.enumerate_pixels().flat_map(|(x, y, &Rgb([red, green, blue]))| {
            let is_same = before.is_some_and(|before| before[(x, y)] == picture[(x, y)]);
            if is_same { [0; 4] } else { [red, green, blue, u8::MAX] }
        });
        writer.write_image_data(&changed.collect::<Vec<u8>>())?;
        before = Some(picture);
    }
    writer.finish()?;
    Ok(file)
}
