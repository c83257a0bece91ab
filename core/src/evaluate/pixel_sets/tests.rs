use super::super::testing::{SIZE, camera, car, photograph, quality, toy_car};
use super::*;
use crate::simulate::{Class, Material, Quality, Scene, classes, grid_lamps};

fn pixels<'a>(sets: &'a [PixelSet], name: &str) -> &'a [u32] {
    &sets.iter().find(|set| set.name == name).unwrap_or_else(|| panic!("no set {name}")).pixels
}

/// Reflectance functions made by formula: r(w) for the 1280 lamps.
fn of(function: impl Fn(&Vec3) -> f64) -> Traits {
    let lamps = grid_lamps(64, 20);
    traits_of(&lamps, &lamps.iter().map(function).collect::<Vec<_>>())
}

#[test]
fn made_functions_have_the_traits_they_were_made_with() {
    let normal = Vec3::new(0.2, 0.8, 0.4).normalize();
    let cosine = |w: &Vec3| 0.3 * normal.dot(w).max(0.0);
    let diffuse = of(cosine);
    assert!(diffuse.gloss < 1e-6 && diffuse.shadow == 0.0 && diffuse.misfit < 1e-6, "{diffuse:?}");
    assert!(Kind::Diffuse.takes(&diffuse) && !Kind::Shadowed.takes(&diffuse));

    // A wall hides everything to the right of a plane.
    let hidden = of(|w| if w.x > 0.25 { 0.0 } else { cosine(w) });
    let lamps = grid_lamps(64, 20);
    let facing: Vec<&Vec3> = lamps.iter().filter(|w| cosine(w) > FACING * 0.3).collect();
    let share = facing.iter().filter(|w| w.x > 0.25).count() as f32 / facing.len() as f32;
    assert!((hidden.shadow - share).abs() < 0.03 && hidden.gloss < 1e-3, "{hidden:?}, hidden {share}");
    assert!(Kind::Shadowed.takes(&hidden));

    // A lobe of some 15 degrees above the cosine.
    let lobe = Vec3::new(-0.3, 0.5, 0.8).normalize();
    let glossy = of(|w| cosine(w) + 0.6 * (30.0 * (w.dot(&lobe) - 1.0)).exp());
    assert!(Kind::Glossy.takes(&glossy) && !Kind::Diffuse.takes(&glossy), "{glossy:?}");
    let mirror = of(|w| f64::from(u8::from(w.dot(&lobe) > 0.995)));
    assert!(mirror.gloss > 0.9 && Kind::Glossy.takes(&mirror), "{mirror:?}");
    assert_eq!(of(|_| 0.0), Traits::default());
}

/// Found sets against what the scene knows of itself: material classes, and, for shadow, the same ground without the car.
#[test]
fn found_sets_agree_with_the_scene() {
    let field = car();
    let asset = &field.asset;
    let traits = traits(asset.samples().unwrap(), asset.directions().unwrap(), &mut |_, _| Ok(())).unwrap();
    let sets = find(&traits, asset.alpha());
    let class = |i: &u32| field.classes.class[*i as usize];
    // The share of some pixels that are of a class; pixels that show several materials have no truth.
    let share = |pixels: &[u32], wanted: Class| {
        let pure: Vec<&u32> = pixels.iter().filter(|i| matches!(class(i), Class::Diffuse | Class::Glossy)).collect();
        pure.iter().filter(|i| class(i) == wanted).count() as f64 / pure.len() as f64
    };
    let (diffuse, glossy, shadowed) = (pixels(&sets, "diffuse"), pixels(&sets, "glossy"), pixels(&sets, "shadowed"));
    for (set, pixels) in [("diffuse", diffuse), ("glossy", glossy), ("shadowed", shadowed)] {
        assert!(pixels.len() >= 40, "{set}: {} pixels", pixels.len());
    }
    let paint = field.classes.pixels(&[Class::Glossy]);
    let found =
        paint.iter().filter(|i| glossy.binary_search(&(**i as u32)).is_ok()).count() as f64 / paint.len() as f64;
    let shares = [share(diffuse, Class::Diffuse), share(shadowed, Class::Diffuse), share(glossy, Class::Glossy), found];
    // The last but one is low: ground below the car that only a few lamps reach has a peak, as a highlight has.
    assert!(shares.iter().zip([0.98, 0.90, 0.65, 0.85]).all(|(share, least)| *share >= least), "{shares:?}");

    // The ground alone: the car takes more than half of a lamp's light where it shades.
    let bare = Scene { objects: toy_car().objects[..1].to_vec() };
    let ground = photograph(&bare, grid_lamps(64, 20), Quality { samples: 16, ..quality() }, SIZE);
    let (with, without) = (field.numbers(), ground.numbers());
    let scale = asset.samples().unwrap().scale() / ground.asset.samples().unwrap().scale();
    let shaded = |i: u32| {
        let i = i as usize;
        // Green will do.
        let lamps = || (1280..2560).map(|j| (with[j][i] * scale, without[j][i]));
        let peak = lamps().fold(0.0, |peak: f32, (_, b)| peak.max(b));
        let facing = || lamps().filter(|(_, b)| *b > 0.3 * peak);
        facing().filter(|(a, b)| *a < 0.5 * b).count() as f64 / facing().count() as f64
    };
    // Pixels that show nothing but ground: those of a mirror in its place.
    let mut marked = toy_car();
    marked.objects[0].material = Material::Mirror { reflectance: [1.0; 3] };
    let marked = classes(&marked, &camera(SIZE));
    let on_ground = |i: &u32| marked.class[*i as usize] == Class::Mirror;
    let part = |pixels: &[u32], holds: &dyn Fn(f64) -> bool| {
        let ground: Vec<u32> = pixels.iter().copied().filter(on_ground).collect();
        ground.iter().filter(|i| holds(shaded(**i))).count() as f64 / ground.len() as f64
    };
    let (in_shadow, in_light) =
        (part(shadowed, &|share| share > 0.05), part(diffuse, &|share| share < f64::from(SHADOWED)));
    assert!(in_shadow > 0.9 && in_light > 0.9, "{in_shadow} of the shadowed, {in_light} of the diffuse");
}

#[test]
fn coverage_and_black_pixels_leave_sets() {
    let lit = Traits { energy: 1.0, ..Traits::default() };
    let traits = [lit, lit, Traits { energy: 0.01, ..lit }, Traits::default()];
    assert_eq!(pixels(&find(&traits, None), "all"), [0, 1]);
    assert_eq!(pixels(&find(&traits, Some(&[1.0, 0.2, 1.0, 1.0])), "all"), [0]);
    assert!(find(&[Traits::default(); 3], None).is_empty());
    assert!(find(&traits, Some(&[0.0; 4])).is_empty());
}

#[test]
fn masks_replace_sets_of_their_name_and_join_others() {
    let found = find(&[Traits { energy: 1.0, ..Traits::default() }; 4], None);
    let mask = |name: &str, x: usize| {
        let picture = Image::from_fn(2, 2, |at, _| [if at == x { 1.0 } else { 0.0 }; 3]);
        PixelSet::from_mask(name, &picture, (2, 2)).unwrap()
    };
    let sets = with_masks(found.clone(), vec![mask("diffuse", 0), mask("wing", 1)]).unwrap();
    let names: Vec<(&str, bool)> = sets.iter().map(|set| (&set.name[..], set.from_mask)).collect();
    assert_eq!(names, [("all", false), ("diffuse", true), ("wing", true)]);
    assert_eq!((pixels(&sets, "diffuse"), pixels(&sets, "wing")), (&[0, 2][..], &[1, 3][..]));
    let message = with_masks(found, vec![mask("wing", 0), mask("wing", 1)]).unwrap_err().to_string();
    assert!(message.contains("two that are called wing"), "{message}");
    let grey = Image::from_fn(2, 2, |_, _| [0.5; 3]);
    assert!(PixelSet::from_mask("wing", &grey, (2, 2)).unwrap_err().to_string().contains("no pixel"));
    let message = PixelSet::from_mask("wing", &grey, (3, 2)).unwrap_err().to_string();
    assert!(message.contains("the mask wing") && message.contains("2 x 2") && message.contains("3 x 2"), "{message}");
}
