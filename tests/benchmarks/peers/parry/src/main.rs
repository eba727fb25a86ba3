//! Parry asked what `bench_collision` asks: numbers in on standard input, seconds a query and the answers out.
//!
//! In: question ("pairs", "collide" or "distance"), passes, two meshes, the number of poses, and of each pose the
//! rotation by rows, the translation (m), and for "pairs" the number of surface pairs to test and those pairs.
//! A mesh: numbers of vertices, triangles and surfaces; the vertices (m); of each triangle its surface and vertices.
//! Out: a line of seconds (median over passes of the mean over poses), then a line an answer.

use parry3d_f64::math::{Matrix, Pose, Rotation, Vector};
use parry3d_f64::query::{distance, intersection_test};
use parry3d_f64::shape::TriMesh;
use std::io::Read;
use std::str::{FromStr, SplitWhitespace};
use std::time::Instant;

fn next<T: FromStr>(words: &mut SplitWhitespace) -> T {
    words
        .next()
        .and_then(|word| word.parse().ok())
        .expect("a number")
}

fn vector(words: &mut SplitWhitespace) -> Vector {
    Vector::new(next(words), next(words), next(words))
}

/// The whole mesh, and one mesh for each surface.
fn meshes(words: &mut SplitWhitespace) -> (TriMesh, Vec<TriMesh>) {
    let (vertices, triangles, surfaces): (usize, usize, usize) =
        (next(words), next(words), next(words));
    let points: Vec<Vector> = (0..vertices).map(|_| vector(words)).collect();
    let mut parts = vec![Vec::new(); surfaces];
    for _ in 0..triangles {
        let surface: usize = next(words);
        parts[surface].push([next::<u32>(words), next(words), next(words)]);
    }
    let mesh = |part: &[[u32; 3]]| {
        let corners = part.iter().flatten().map(|&i| points[i as usize]).collect();
        let indices = (0..part.len() as u32)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect();
        TriMesh::new(corners, indices).expect("a mesh")
    };
    (
        mesh(&parts.concat()),
        parts.iter().map(|part| mesh(part)).collect(),
    )
}

struct Query {
    pose: Pose,
    near: Vec<(usize, usize)>,
}

fn answer(
    question: &str,
    query: &Query,
    a: &(TriMesh, Vec<TriMesh>),
    b: &(TriMesh, Vec<TriMesh>),
) -> String {
    let here = Pose::IDENTITY;
    let meet = |u, v| {
        intersection_test(&here, u, &query.pose, v)
            .expect("two meshes")
            .intersecting
    };
    match question {
        "collide" => u8::from(meet(&a.0, &b.0)).to_string(),
        "distance" => format!(
            "{:e}",
            distance(&here, &a.0, &query.pose, &b.0)
                .expect("two meshes")
                .distance
        ),
        _ => {
            let pairs = query.near.iter().filter(|(s, t)| meet(&a.1[*s], &b.1[*t]));
            pairs.map(|(s, t)| format!("{s} {t} ")).collect()
        }
    }
}

fn main() {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text).expect("text");
    let words = &mut text.split_whitespace();
    let (question, passes): (String, usize) = (next(words), next(words));
    let (a, b) = (meshes(words), meshes(words));
    let queries: Vec<Query> = (0..next(words))
        .map(|_: usize| {
            let rows = [vector(words), vector(words), vector(words)];
            let rotation =
                Rotation::from_mat3(&Matrix::from_cols(rows[0], rows[1], rows[2]).transpose());
            let pose = Pose::from_parts(vector(words), rotation);
            let near = if question == "pairs" { next(words) } else { 0 };
            Query {
                pose,
                near: (0..near).map(|_| (next(words), next(words))).collect(),
            }
        })
        .collect();
    let ask = || {
        queries
            .iter()
            .map(|query| answer(&question, query, &a, &b))
            .collect::<Vec<String>>()
    };
    let answers = ask();
    let mut seconds: Vec<f64> = (0..passes)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(ask());
            start.elapsed().as_secs_f64() / queries.len() as f64
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    println!("{:e}\n{}", seconds[passes / 2], answers.join("\n"));
}
