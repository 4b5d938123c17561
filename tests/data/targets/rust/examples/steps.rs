//! 2000 steps from the start of the model: cargo run --example steps
use wheeled_satellite_gl2_gamma::{Failure, Stepper, MODEL_Q};

fn main() -> Result<(), Failure> {
    let mut stepper = Stepper::of_model()?;
    for _ in 0..2000 {
        stepper.advance()?;
    }
    if std::env::args().count() > 1 {
        // any argument: the bits, to compare
        for x in stepper.q.iter().chain(&stepper.p) {
            x.to_ne_bytes().iter().for_each(|byte| print!("{byte:02x}"));
        }
        println!();
    } else {
        for (i, x) in stepper.q.iter().enumerate() {
            println!("q{i}: {:.9} -> {x:.9}", MODEL_Q[i]);
        }
        println!("H: {:.9}", stepper.energy());
    }
    Ok(())
}
