// Test bench of one core: it loads the images of a folder `core<number>` that --emit vectors wrote, plays axon_spikes,
// computes every compartment of every step, and compares spikes, u and v. It also shows a designer of a core how to read
// the files: put a design under test in place of the tasks `update` and `deliver`. The positions of bits below are those of
// loihi-sim; manifest.yaml has them for other chips.
//
//   iverilog -g2012 -Pcore_bench.COMPARTMENTS=... (the other sizes) -o bench core_bench.v && vvp bench +folder=core0
module core_bench;
  parameter AXONS = 1, LISTS = 1, WORDS = 1, FORMATS = 1, PROFILES = 1, THRESHOLDS = 1, COMPARTMENTS = 1, STEPS = 1;
  parameter signed [31:0] VMIN = -8388607, VMAX = 8388607;
  localparam SLOTS = 64;  // steps for which charge can wait: delays are at most 62, and charge acts a step later

  // The files, a word per row.
  reg [29:0] axons[0:AXONS-1];
  reg [39:0] lists[0:LISTS-1];
  reg [63:0] memory[0:WORDS-1];
  reg [16:0] formats[0:FORMATS-1];
  reg [32:0] profiles[0:PROFILES-1];
  reg [16:0] thresholds[0:THRESHOLDS-1];
  reg [35:0] compartments[0:COMPARTMENTS-1];
  reg [AXONS-1:0] axon_spikes[0:STEPS-1];
  reg [COMPARTMENTS-1:0] spikes[0:STEPS-1];
  reg [23:0] expected_u[0:STEPS*COMPARTMENTS-1];
  reg [23:0] expected_v[0:STEPS*COMPARTMENTS-1];

  reg signed [63:0] due[0:SLOTS*COMPARTMENTS-1];  // charge for each compartment, by the step in which it acts, modulo SLOTS
  reg signed [63:0] u[0:COMPARTMENTS-1], v[0:COMPARTMENTS-1];
  reg signed [63:0] joined[0:COMPARTMENTS-1];  // voltage that dendrites add to a compartment in this step
  integer blocked[0:COMPARTMENTS-1];  // steps for which a compartment is still refractory
  reg [COMPARTMENTS-1:0] fired;
  integer step, i, differ;
  reg [8*256-1:0] folder;

  // x after a decay of d parts of 4096, truncated toward zero.
  function signed [63:0] decayed(input signed [63:0] x, input [12:0] d);
    decayed = x < 0 ? -((-x * (4096 - d)) >>> 12) : (x * (4096 - d)) >>> 12;
  endfunction

  // x as a register of `bits` bits and a sign holds it.
  function signed [63:0] wrapped(input signed [63:0] x, input integer bits);
    wrapped = ((x + (64'sd1 <<< bits)) & ((64'sd1 <<< (bits + 1)) - 1)) - (64'sd1 <<< bits);
  endfunction

  // `width` bits from bit `low` on, of the run that begins at memory word `at`; runs may take several words.
  function [31:0] taken(input integer at, input integer low, input integer width);
    integer k;
    begin
      taken = 0;
      for (k = 0; k < width; k = k + 1) taken[k] = memory[at+(low+k)/64][(low+k)%64];
    end
  endfunction

  // The charge that a synapse adds, from its stored weight and its format. Bits of a format: 3:0 bits of a weight, 5:4 sign mode
  // (mixed, excitatory, inhibitory), 9:6 exponent, 12:10 bits of a delay, 16:13 bits of an index.
  function signed [63:0] weight(input [31:0] stored, input [16:0] form);
    reg signed [63:0] m;
    integer bits;
    begin
      bits = form[3:0];
      // Narrow weights lie on a coarser grid: they are shifted up to 8 bits, and a mixed weight has a bit for its sign.
      case (form[5:4])
        0: m = (stored[bits-1] ? $signed({32'd0, stored}) - (64'sd1 <<< bits) : $signed({32'd0, stored})) <<< (9 - bits);
        1: m = $signed({32'd0, stored}) <<< (8 - bits);
        default: m = -($signed({32'd0, stored}) <<< (8 - bits));
      endcase
      weight = ($signed(form[9:6]) >= 0 ? m <<< form[9:6] : m >>> -$signed({{28{form[9]}}, form[9:6]})) <<< 6;
    end
  endfunction

  // Add the charge of all synapses of an axon. Its lists are runs of synapses: a header of 10 bits (format, number of synapses
  // minus one), then weight, delay and index of each synapse.
  task deliver(input integer axon);
    integer l, at, stop, count, s, low, target, slot;
    reg [16:0] form;
    for (l = axons[axon][14:0]; l < axons[axon][14:0] + axons[axon][29:15]; l = l + 1) begin
      at = lists[l][14:0];
      stop = at + lists[l][29:15];
      target = lists[l][39:30];  // where synapses without an index begin
      while (at < stop) begin
        form = formats[memory[at][3:0]];
        count = memory[at][9:4] + 1;
        low = 10;
        for (s = 0; s < count; s = s + 1) begin
          slot = (step + 1 + taken(at, low + form[3:0], form[12:10])) % SLOTS;
          if (form[16:13] != 0) target = taken(at, low + form[3:0] + form[12:10], form[16:13]);
          due[slot*COMPARTMENTS+target] = due[slot*COMPARTMENTS+target] + weight(taken(at, low, form[3:0]), form);
          if (form[16:13] == 0) target = target + 1;
          low = low + form[3:0] + form[12:10] + form[16:13];
        end
        at = at + (low + 63) / 64;  // a run ends with a whole word
      end
    end
  endtask

  // The step of compartment c. Dendrites have lower numbers than their parents, so a parent finds their voltages in `joined`.
  task update(input integer c);
    reg [32:0] profile;
    reg signed [63:0] bias, x;
    integer slot;
    begin
      profile = profiles[compartments[c][4:0]];
      slot = (step % SLOTS) * COMPARTMENTS + c;
      bias = $signed(compartments[c][21:9]);
      bias = bias <<< compartments[c][24:22];
      u[c] = wrapped(decayed(u[c], profile[12:0]) + wrapped(due[slot], 21), 23);
      due[slot] = 0;
      x = decayed(v[c], profile[25:13]) + wrapped(u[c] + bias, 23) + joined[c];
      x = x > VMAX ? VMAX : x < VMIN ? VMIN : x;
      fired[c] = 0;
      // Bit 32 of a profile marks a compartment that is joined to a parent, and never spikes. A threshold counts in 64ths of v.
      if (blocked[c] > 0) begin
        blocked[c] = blocked[c] - 1;
        x = 0;
      end else if (!profile[32] && x > $signed({41'd0, thresholds[compartments[c][8:5]], 6'd0})) begin
        fired[c] = 1;
        blocked[c] = profile[31:26] - 1;
        x = 0;
      end
      v[c] = x;
      joined[c] = 0;
      if (compartments[c][25]) joined[compartments[c][35:26]] = joined[compartments[c][35:26]] + x;
    end
  endtask

  initial begin
    if (!$value$plusargs("folder=%s", folder)) folder = "core0";
    $readmemh({folder, "/axons.hex"}, axons);
    $readmemh({folder, "/lists.hex"}, lists);
    $readmemh({folder, "/synapses.hex"}, memory);
    $readmemh({folder, "/formats.hex"}, formats);
    $readmemh({folder, "/profiles.hex"}, profiles);
    $readmemh({folder, "/thresholds.hex"}, thresholds);
    $readmemh({folder, "/compartments.hex"}, compartments);
    $readmemh({folder, "/axon_spikes.hex"}, axon_spikes);
    $readmemh({folder, "/spikes.hex"}, spikes);
    $readmemh({folder, "/u.hex"}, expected_u);
    $readmemh({folder, "/v.hex"}, expected_v);
    for (i = 0; i < SLOTS * COMPARTMENTS; i = i + 1) due[i] = 0;
    for (i = 0; i < COMPARTMENTS; i = i + 1) begin
      u[i] = 0;
      v[i] = 0;
      joined[i] = 0;
      blocked[i] = 0;
    end
    differ = 0;
    // Spikes of a step are delivered after the updates, as they act from the next step on.
    for (step = 0; step < STEPS; step = step + 1) begin
      for (i = 0; i < COMPARTMENTS; i = i + 1) update(i);
      for (i = 0; i < COMPARTMENTS; i = i + 1)
        differ = differ + (u[i][23:0] !== expected_u[step*COMPARTMENTS+i]) + (v[i][23:0] !== expected_v[step*COMPARTMENTS+i])
               + (fired[i] !== spikes[step][i]);
      for (i = 0; i < AXONS; i = i + 1) if (axon_spikes[step][i]) deliver(i);
    end
    $display("%0d of %0d values differ", differ, 3 * STEPS * COMPARTMENTS);
    $finish(0);
  end
endmodule
